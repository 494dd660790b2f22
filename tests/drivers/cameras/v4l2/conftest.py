import pytest

from tests.drivers.cameras.v4l2.fake_capture import FakeDevice
from tests.drivers.cameras.v4l2.rigs import make


@pytest.fixture
def device():
    return FakeDevice()


@pytest.fixture
def camera(device):
    camera = make(device, frame_rate_hz=100.0, exposure_s=0.005, stall_timeout_s=0.3, reconnect_s=[0.05, 0.2])
    camera.connect()
    yield camera
    device.present, _ = True, device.silent.clear()
    camera.close()
