"""XIMC stages do what every axis must: a translation over TCP, a rotation over a serial port, and real ones."""

import os

import pytest

from drivers.clock import HostClock
from drivers.stages.ximc.entries import AXIS
from tests.drivers.contract.axis_contract import AxisContract
from tests.drivers.stages.real import RealStage
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
        return (1.0, 7.0, 6.5)


class TestRotationOverSerial(OnAnEmulator):
    unit = "deg"
    transport = "pty"

    @pytest.fixture
    def places(self):
        return (-2.0, 4.0, 3.5)


if "BSCD_REAL_XIMC" in os.environ:

    class TestRealStage(RealStage):
        file = os.environ["BSCD_REAL_XIMC"]
        entry = AXIS
