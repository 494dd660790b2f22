"""XIMC stages do what every axis must: a translation over TCP, a rotation over a serial port, and real ones."""

import json
import os

import pytest

from drivers.clock import HostClock
from drivers.registry import DriverContext
from drivers.stages.ximc.entries import AXIS
from tests.drivers.contract.axis_contract import AxisContract
from tests.drivers.stages.rigs import serving, ximc_axis, ximc_emulator


class OnAnEmulator(AxisContract):
    unit = "mm"
    transport = "tcp"

    @pytest.fixture
    def clock(self):
        return HostClock()

    @pytest.fixture
    def axis(self):
        with serving(ximc_emulator(self.unit, self.transport)) as emulator:
            axis = ximc_axis(self.unit, emulator.address)
            yield axis
            axis.close()


class TestTranslationOverTcp(OnAnEmulator):
    @pytest.fixture
    def places(self):
        return (3.0, 15.0, 14.0)


class TestRotationOverSerial(OnAnEmulator):
    unit = "deg"
    transport = "pty"

    @pytest.fixture
    def places(self):
        return (-3.0, 9.0, 8.0)


@pytest.mark.skipif("BSCD_REAL_XIMC" not in os.environ, reason="BSCD_REAL_XIMC names no options of a real stage")
class TestRealStage(AxisContract):
    """BSCD_REAL_XIMC: a JSON file with the driver's "options" and three "places" that it may travel between."""

    @pytest.fixture
    def given(self):
        with open(os.environ["BSCD_REAL_XIMC"]) as file:
            return json.load(file)

    @pytest.fixture
    def clock(self):
        return HostClock()

    @pytest.fixture
    def axis(self, given):
        axis = AXIS.build(given["options"], DriverContext("stage"))
        yield axis
        axis.close()

    @pytest.fixture
    def places(self, given):
        return tuple(given["places"])
