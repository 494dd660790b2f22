"""The contract of every camera, held by the Aravis driver: on emulated cameras, and on real ones that are named.

``BSCD_ARAVIS_SERIAL`` (or ``BSCD_ARAVIS_ADDRESS``) names a real camera to test; see docs/drivers/aravis.md.
"""

import os

import pytest

from drivers.cameras.aravis import AravisCamera, AravisOptions
from drivers.clock import HostClock
from drivers.registry import DriverContext
from tests.drivers.contract.camera_contract import CameraContract
from tests.drivers.gige_rig import require_aravis, serving, small_world


class OnTheHost(CameraContract):
    @pytest.fixture
    def clock(self):
        return HostClock()


@pytest.mark.own_network
class TestEmulatedCamera(OnTheHost):
    @pytest.fixture
    def camera(self, emulator):
        return AravisCamera(AravisOptions(address=emulator.address), DriverContext("primary"))


@pytest.fixture(scope="class")
def twelve_bits():
    world = small_world(bits=12)
    with serving(world) as emulator:
        yield emulator
    world.close()


@pytest.mark.own_network
class TestTwelvePackedBits(OnTheHost):
    @pytest.fixture
    def camera(self, twelve_bits):
        options = AravisOptions(address=twelve_bits.address, pixel_format="Mono12Packed")
        return AravisCamera(options, DriverContext("primary"))


SERIAL, ADDRESS = os.environ.get("BSCD_ARAVIS_SERIAL", ""), os.environ.get("BSCD_ARAVIS_ADDRESS", "")


class TestRealCamera(OnTheHost):
    __test__ = bool(SERIAL or ADDRESS)

    @pytest.fixture
    def camera(self):
        require_aravis()
        options = AravisOptions(serial=SERIAL, address="" if SERIAL else ADDRESS, pixel_size_mm=0.005)
        return AravisCamera(options, DriverContext("real"))
