"""A folder and a run as cameras: the contract, the very pixels, their order, losses, times and the end."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from bscd.acquisition import RunWriter
from bscd.acquisition.replay import ReplayCamera, ReplayOptions
from drivers.clock import VirtualClock
from drivers.errors import DeviceFaultError, DeviceTimeoutError, NotConnectedError
from drivers.interfaces import Camera, FrameStatus
from drivers.registry import DriverContext, installed_drivers
from tests.acquisition.run_records import SETTINGS, frames
from tests.drivers.contract.camera_contract import CameraContract


def images(count=4, seed=3):
    rng = np.random.default_rng(seed)
    return [rng.integers(0, 256, (8, 12)).astype(np.uint8) for _ in range(count)]


def write_folder(folder, pictures):
    for number, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"frame{number + 8}.png"), picture)  # frame8 ... frame11: by name 10 is before 8
    return folder


def write_run(path, records):
    with RunWriter(path, **SETTINGS) as writer:
        for record in records:
            writer.append(record)
    return path


@pytest.fixture
def clock():
    return VirtualClock(100.0)


@pytest.fixture
def folder(tmp_path):
    return write_folder(tmp_path, images())


@pytest.fixture
def run(tmp_path):
    return write_run(tmp_path / "run.h5", frames(12))


def play(source, clock, **options):
    camera = ReplayCamera(ReplayOptions.model_validate({"source": source, **options}), "primary", clock)
    camera.connect()
    return camera


class TestFolder(CameraContract):
    @pytest.fixture
    def clock(self):
        return VirtualClock()

    @pytest.fixture
    def camera(self, folder, clock):
        return ReplayCamera(ReplayOptions(source=folder, repeat=True, pixel_size_mm=0.0067), "primary", clock)


class TestRun(CameraContract):
    @pytest.fixture
    def clock(self):
        return VirtualClock()

    @pytest.fixture
    def camera(self, run, clock):
        return ReplayCamera(ReplayOptions(source=run, repeat=True), "primary", clock)


class TestTwelveBitRun(CameraContract):
    @pytest.fixture
    def clock(self):
        return VirtualClock()

    @pytest.fixture
    def camera(self, run, clock):
        options = ReplayOptions(source=run, camera="auxiliary", repeat=True, pixel_size_mm=0.005)
        return ReplayCamera(options, "auxiliary", clock)


def test_a_folder_is_shown_in_natural_order_and_once(folder, clock):
    camera = play(folder, clock)
    shown = [camera.snap().data for _ in range(2)]
    camera.start()
    shown += [camera.read().data for _ in range(2)]
    assert all(np.array_equal(a, b) for a, b in zip(shown, images(), strict=True))
    with pytest.raises(DeviceTimeoutError, match="primary: reading a frame: the recording is at its end"):
        camera.read()
    camera.stop()
    with pytest.raises(DeviceTimeoutError, match="at its end"):
        camera.snap()
    camera.close()
    camera.connect()
    assert np.array_equal(camera.snap().data, images()[0])
    camera.close()


def test_repeating_goes_on_with_the_count(folder, clock):
    camera = play(folder, clock, repeat=True)
    shown = [camera.snap() for _ in range(9)]
    assert [frame.frame_id for frame in shown] == list(range(9))
    assert np.array_equal(shown[8].data, images()[0])
    camera.close()


def test_a_stop_loses_no_image(folder, clock):
    camera = play(folder, clock)
    camera.start()
    camera.read()
    camera.stop()
    assert np.array_equal(camera.snap().data, images()[1])
    camera.close()


def test_a_run_keeps_its_losses_its_marks_and_its_times(tmp_path, clock):
    records = [record for record in frames(12) if record.camera == "primary"]
    records = [replace(record, camera_time_ns=round(1e9 * k * 0.05)) for k, record in enumerate(records)]
    records[3] = replace(records[3], status=FrameStatus.INCOMPLETE)
    del records[1]
    camera = play(write_run(tmp_path / "run.h5", records), clock, pace="recorded")
    camera.start()
    shown = [camera.read() for _ in records]
    assert [frame.frame_id for frame in shown] == [0, 2, 3, 4, 5]
    assert [frame.status for frame in shown] == [record.status for record in records]
    assert all(np.array_equal(frame.data, record.data) for frame, record in zip(shown, records, strict=True))
    assert np.diff([frame.camera_time_ns for frame in shown]) == pytest.approx([1e8, 5e7, 5e7, 5e7])
    assert camera.status().lost_frames == 1
    assert camera.info().serial == "0001"
    camera.close()


def test_as_fast_as_asked(run, clock):
    camera = play(run, clock, pace="fast")
    before_s = clock.now_s()
    camera.start()
    for _ in range(6):
        camera.read(timeout_s=0.0)
    assert clock.now_s() == before_s
    camera.close()
    camera = play(run, clock, frame_rate_hz=4.0, exposure_s=0.01)
    before_s = clock.now_s()
    camera.start()
    for _ in range(6):
        camera.read()
    assert clock.now_s() - before_s == pytest.approx(5 * 0.25 + 0.01)
    camera.close()


def test_only_the_phase_that_is_asked_for(tmp_path, clock):
    records = [replace(record, phase="sphere" if k > 3 else "bsc-face") for k, record in enumerate(frames(12))]
    camera = play(write_run(tmp_path / "run.h5", records), clock, phase="sphere", pace="fast")
    camera.start()
    first = next(record for record in records if record.phase == "sphere" and record.camera == "primary")
    assert np.array_equal(camera.read().data, first.data)
    camera.close()


def test_what_can_not_be_played_is_named(tmp_path, run, clock):
    empty = tmp_path / "empty"
    empty.mkdir()
    for source, options, message in (
        (tmp_path / "nothing.h5", {}, "nothing.h5"),
        (empty, {}, "holds no image"),
        (run, {"phase": "sphere"}, "no frame of the primary camera in phase sphere"),
    ):
        with pytest.raises(NotConnectedError, match=message):
            play(source, clock, **options)
    one = write_run(tmp_path / "one.h5", [r for r in frames(4) if r.camera == "primary"])
    with pytest.raises(NotConnectedError, match="no frame of the auxiliary camera"):
        play(one, clock, camera="auxiliary")


def test_an_image_that_differs_ends_it_with_an_error(folder, clock):
    cv2.imwrite(str(folder / "frame9.png"), np.zeros((4, 4), np.uint8))
    camera = play(folder, clock)
    camera.snap()
    with pytest.raises(DeviceFaultError, match=r"frame9\.png differs from the first image"):
        camera.snap()
    camera.close()


def test_the_registry_builds_it(folder):
    entry = installed_drivers()["camera.replay"]
    camera = entry.build({"source": str(folder), "pace": "fast"}, DriverContext("primary"))
    assert isinstance(camera, Camera)
    for wrong in ({"pace": "slow"}, {"exposure_s": 1.0}, {"camera": "third"}, {"bit_depth": 3}):
        with pytest.raises(ValidationError):
            entry.build({"source": str(folder), **wrong}, DriverContext("primary"))
