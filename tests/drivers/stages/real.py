"""The axis contract on a real stage, opted in by an environment variable."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from drivers.clock import HostClock
from drivers.registry import DriverContext, DriverEntry
from tests.drivers.contract.axis_contract import AxisContract


class RealStage(AxisContract):
    """``file``: JSON with the driver's "options", and three "places" that it may travel between."""

    file = ""
    entry: DriverEntry

    @pytest.fixture
    def given(self):
        return json.loads(Path(self.file).read_text())

    @pytest.fixture
    def clock(self):
        return HostClock()

    @pytest.fixture
    def axis(self, given):
        axis = self.entry.build(given["options"], DriverContext("stage"))
        yield axis
        axis.close()

    @pytest.fixture
    def places(self, given):
        return tuple(given["places"])
