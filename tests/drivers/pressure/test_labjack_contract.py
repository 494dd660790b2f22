"""The LabJack's sources keep the pressure contract, on the emulated T7, and on a real one if there is any.

For a real one BSCD_REAL_LABJACK names a JSON file with "options"; the rig must stand 5 kPa.
"""

import json
import os
from pathlib import Path

import pytest

from drivers.clock import HostClock
from drivers.interfaces import SampledPressureSource
from drivers.pressure.labjack_t7 import PRESSURE
from drivers.registry import DriverContext
from tests.drivers.contract.pressure_contract import PressureContract
from tests.drivers.pressure.rigs import pressure_rig


@pytest.mark.parametrize("kind", ["labjack_t7", "manual"])
class TestEmulatedT7(PressureContract):
    settle_s = 0.4

    @pytest.fixture
    def clock(self):
        return HostClock()

    @pytest.fixture
    def source(self, kind):
        with pressure_rig(kind, answer_timeout_s=3.0) as rig:
            yield rig.driver

    def test_samples_by_itself(self, source):
        assert isinstance(source, SampledPressureSource)


if "BSCD_REAL_LABJACK" in os.environ:

    class TestRealT7(PressureContract):
        @pytest.fixture
        def clock(self):
            return HostClock()

        @pytest.fixture
        def source(self):
            given = json.loads(Path(os.environ["BSCD_REAL_LABJACK"]).read_text())
            return PRESSURE.build(given["options"], DriverContext("pressure"))
