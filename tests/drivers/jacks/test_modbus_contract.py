"""The Modbus jacks keep the axis contract, on emulated drives behind TCP and RTU, and on real ones if there are any.

For real ones BSCD_REAL_JACKS names a JSON file with "options" and three "places".
"""

import os

import pytest

from drivers.clock import HostClock
from drivers.jacks.modbus import AXIS
from tests.drivers.contract.axis_contract import AxisContract
from tests.drivers.jacks.rigs import TRANSPORTS, jack_rig
from tests.drivers.stages.real import RealStage


@pytest.mark.parametrize("transport", TRANSPORTS)
class TestEmulatedJacks(AxisContract):
    @pytest.fixture
    def clock(self):
        return HostClock()

    @pytest.fixture
    def axis(self, transport):
        with jack_rig(transport) as rig:
            yield rig.driver

    @pytest.fixture
    def places(self):
        return (8.0, 28.0, 40.0)


if "BSCD_REAL_JACKS" in os.environ:

    class TestRealJacks(RealStage):
        file = os.environ["BSCD_REAL_JACKS"]
        entry = AXIS
