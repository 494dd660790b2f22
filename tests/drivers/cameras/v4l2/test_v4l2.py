"""The V4L2 driver on a capture that is put in its place; on a real or ``vivid`` device with BSCD_V4L2_DEVICE."""

import os
import threading
import time

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.cameras.v4l2 import V4l2Camera, V4l2Options
from drivers.cameras.v4l2.inference import InferredCount
from drivers.clock import HostClock
from drivers.errors import NotConnectedError, OutOfLimitsError
from drivers.interfaces import Camera
from drivers.registry import DriverContext, installed_drivers
from tests.drivers.cameras.v4l2.fake_capture import FakeDevice
from tests.drivers.cameras.v4l2.rigs import PATH, make, until
from tests.drivers.contract.camera_contract import CameraContract


class OnTheHost(CameraContract):
    @pytest.fixture
    def clock(self):
        return HostClock()


class TestInjectedCapture(OnTheHost):
    @pytest.fixture
    def camera(self):
        return make(FakeDevice())


class TestTwelveBits(OnTheHost):
    @pytest.fixture
    def camera(self):
        return make(FakeDevice(), pixel_format="Y12 ")


DEVICE = os.environ.get("BSCD_V4L2_DEVICE", "")


@pytest.mark.v4l2
class TestRealDevice(OnTheHost):
    """Set BSCD_V4L2_FORMAT, BSCD_V4L2_SIZE ("640x480") too; a ``vivid`` device takes GREY 640x360 at 10 Hz."""

    __test__ = bool(DEVICE)

    @pytest.fixture
    def camera(self):
        width, height = os.environ.get("BSCD_V4L2_SIZE", "640x480").split("x")
        options = V4l2Options.model_validate(
            {
                "device": DEVICE,
                "width_px": int(width),
                "height_px": int(height),
                "pixel_format": os.environ.get("BSCD_V4L2_FORMAT", "YUYV"),
                "pixel_size_mm": 0.005,
            }
        )
        return V4l2Camera(options, DriverContext("real"))


@pytest.mark.parametrize("pixel_format", ["GREY", "YUYV", "MJPG"])
def test_the_luma_of_every_format(device, pixel_format):
    camera = make(device, pixel_format=pixel_format, frame_rate_hz=30.0)
    camera.connect()
    frame = camera.snap()
    camera.close()
    assert frame.data.dtype == np.uint8
    assert set(frame.data.ravel()[1:].tolist()) == {20}  # 20 ms are 200 steps of 100 us


def test_size_and_format_that_it_does_not_take_are_refused(device):
    for options in ({"width_px": 64}, {"pixel_format": "Y16 "}):
        with pytest.raises(OutOfLimitsError, match="it offers 32 x 24"):
            make(device, **options).connect()
    assert device.opened == device.released == 2


def test_a_device_that_is_not_there_is_named(device):
    device.present = False
    with pytest.raises(NotConnectedError, match="ls /dev/v4l/by-id"):
        make(device).connect()
    assert device.opened == device.released


def test_a_snap_is_never_older_than_the_call(camera):
    for _ in range(5):
        time.sleep(0.03)
        before_ns = time.monotonic_ns()
        frame = camera.snap()
        assert frame.camera_time_ns - round(0.0025e9) >= before_ns


def test_frames_that_the_camera_left_out_are_inferred_from_time_stamps(camera, device):
    camera.start()
    first = camera.read()
    device.skip = 3
    ids = [camera.read().frame_id - first.frame_id for _ in range(20)]
    (jump,) = [step for step in np.diff([0, *ids]) if step != 1]
    assert jump == 4
    assert camera.status().lost_frames == 3


def test_broken_images_are_counted_and_not_handed_over(camera, device):
    camera.start()
    first = camera.read()
    device.break_images = 2
    ids = [first.frame_id, *(camera.read().frame_id for _ in range(10))]
    assert sorted(np.diff(ids).tolist()) == [1] * 9 + [3]
    assert camera.status().lost_frames == 2


def test_frames_for_which_there_is_no_room_are_counted(device):
    camera = make(device, frame_rate_hz=100.0, exposure_s=0.005, buffer_frames=4)
    camera.connect()
    camera.start()
    first = camera.read()
    until(lambda: camera.status().lost_frames >= 6)
    ids = [camera.read().frame_id - first.frame_id for _ in range(6)]
    camera.close()
    assert ids[:4] == [1, 2, 3, 4] and ids[4] > 9


def test_a_driver_without_time_stamps_is_timed_on_arrival(device):
    device.stamps = False
    camera = make(device, frame_rate_hz=50.0, exposure_s=0.005)
    camera.connect()
    frame = camera.snap()
    camera.close()
    assert abs(frame.camera_time_ns + round(0.0025e9) - frame.host_time_ns) < 1_000


def test_close_joins_its_thread_and_releases(device):
    camera = make(device, frame_rate_hz=50.0, exposure_s=0.005)
    before = threading.active_count()
    camera.connect()
    camera.snap()
    camera.close()
    assert threading.active_count() == before
    assert device.opened == device.released == 1


@pytest.mark.parametrize(
    ("times_ms", "ids", "missing"),
    [([0, 100, 200], [0, 1, 2], 0), ([0, 100, 400, 500], [0, 1, 4, 5], 2), ([0, 140, 200, 351], [0, 1, 2, 4], 1)],
)
def test_inference(times_ms, ids, missing):
    count = InferredCount()
    results = [count.count(round(1e6 * t), 0.1) for t in times_ms]
    assert [frame_id for frame_id, _ in results] == ids
    assert sum(lost for _, lost in results) == missing


def test_what_can_be_seen_is_listed_by_its_lasting_name(tmp_path, monkeypatch):
    find = installed_drivers()["camera.v4l2"].find
    assert find is not None
    monkeypatch.setattr("drivers.ports.DEV", tmp_path)
    assert find() == []
    (tmp_path / "v4l/by-id").mkdir(parents=True)
    (tmp_path / "video0").touch()
    name = tmp_path / "v4l/by-id/usb-Maker_Camera_0001-video-index0"
    name.symlink_to("../../video0")
    assert find() == [f"{name} ({tmp_path / 'video0'})"]


def test_the_registry_builds_it():
    entry = installed_drivers()["camera.v4l2"]
    camera = entry.build({"device": PATH, "pixel_size_mm": 0.003}, DriverContext("auxiliary"))
    assert isinstance(camera, V4l2Camera)
    assert isinstance(camera, Camera)
    for wrong in ({"gain_db": 90}, {"exposure_s": 0.2}, {"pixel_format": "RGB3"}, {"reconnect_s": [2, 1]}):
        with pytest.raises(ValidationError):
            entry.build({"device": PATH, "pixel_size_mm": 0.003, **wrong}, DriverContext("auxiliary"))
