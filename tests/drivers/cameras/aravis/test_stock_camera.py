"""The driver on a camera that is not ours: Aravis's own fake one, as its tools bring it."""

import shutil
import subprocess
import time

import numpy as np
import pytest

from drivers.cameras.aravis.discovery import list_cameras
from drivers.interfaces import FrameStatus
from tests.drivers.gige_rig import open_camera, require_aravis
from tests.drivers.own_network import one_at_a_time

pytestmark = pytest.mark.own_network

SERIAL = "STOCK"


@pytest.fixture(scope="module")
def stock():
    """Its serial number."""
    require_aravis()
    path = shutil.which("arv-fake-gv-camera-0.8")
    if path is None:
        pytest.skip("arv-fake-gv-camera-0.8 is missing; run: apt-get install aravis-tools aravis-tools-cli")
    command = [path, "-i", "127.0.0.1", "-s", SERIAL]
    with one_at_a_time(), subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        deadline_s = time.monotonic() + 20.0
        while not any(SERIAL in line for line in list_cameras()):
            assert process.poll() is None and time.monotonic() < deadline_s
        yield SERIAL
        process.terminate()


def test_it_is_found_set_and_snapped(stock):
    with open_camera("", serial=stock) as camera:
        info = camera.info()
        assert (info.vendor, info.model, info.serial, info.bit_depth) == ("Aravis", "Fake", stock, 8)
        camera.configure(exposure_s=0.01, gain_db=1.0, frame_rate_hz=20.0)
        status = camera.status()
        assert (status.exposure_s, status.gain_db, status.frame_rate_hz) == pytest.approx((0.01, 1.0, 20.0))
        frame = camera.snap()
        assert frame.data.shape == (info.height_px, info.width_px) == (2048, 2048)
        assert frame.status is FrameStatus.OK
        assert np.ptp(frame.data) > 0


def test_a_region_streams_in_order_and_loses_none(stock):
    with open_camera("", serial=stock, region_px=[16, 32, 256, 128], frame_rate_hz=50.0, exposure_s=0.01) as camera:
        camera.start()
        frames = [camera.read() for _ in range(50)]
        assert {frame.data.shape for frame in frames} == {(128, 256)}
        assert np.diff([frame.frame_id for frame in frames]).tolist() == [1] * 49
        assert np.all(np.diff([frame.camera_time_ns for frame in frames]) > 0)
        assert camera.status().lost_frames == 0


def test_a_software_trigger_makes_one_frame(stock):
    with open_camera("", serial=stock, trigger="software", region_px=[0, 0, 256, 128], exposure_s=0.01) as camera:
        camera.start()
        ids = []
        for _ in range(5):
            camera.trigger()
            ids.append(camera.read().frame_id)
        assert np.diff(ids).tolist() == [1] * 4
        with pytest.raises(Exception, match="none came"):
            camera.read(timeout_s=0.3)
