"""Zaber stages do what every axis must: a translation over a serial port, a rotation over TCP, and real ones."""

import os

import pytest

from drivers.clock import HostClock
from drivers.stages.zaber.entries import AXIS
from tests.drivers.contract.axis_contract import AxisContract
from tests.drivers.stages.real import RealStage
from tests.drivers.stages.rigs import serving, zaber_axis, zaber_emulator


class OnAnEmulator(AxisContract):
    unit = "mm"
    transport = "pty"

    @pytest.fixture
    def clock(self):
        return HostClock()

    @pytest.fixture
    def axis(self):
        with serving(zaber_emulator(self.unit, transport=self.transport)) as emulator:
            axis = zaber_axis(self.unit, emulator.address)
            yield axis
            axis.close()


class TestTranslationOverSerial(OnAnEmulator):
    @pytest.fixture
    def places(self):
        return (1.0, 7.0, 6.5)


class TestRotationOverTcp(OnAnEmulator):
    unit = "deg"
    transport = "tcp"

    @pytest.fixture
    def places(self):
        return (-2.0, 4.0, 3.5)


if "BSCD_REAL_ZABER" in os.environ:

    class TestRealStage(RealStage):
        file = os.environ["BSCD_REAL_ZABER"]
        entry = AXIS
