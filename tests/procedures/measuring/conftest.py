from pathlib import Path

import pytest

from bscd.calibration import Calibration
from tests.procedures.measuring.twin_runs import PRESSURES_KPA, TwinRuns, wide_calibration, write


@pytest.fixture(scope="session")
def wide() -> Calibration:
    """A calibration through the biprism that a whole membrane fits into."""
    return wide_calibration()


@pytest.fixture(scope="session")
def twin_runs():
    runs = TwinRuns()
    yield runs
    runs.world.close()


@pytest.fixture(scope="session")
def sphere_run(twin_runs: TwinRuns, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sphere") / "sphere.h5"
    return write(path, twin_runs.sphere(), ("primary", "auxiliary"))


@pytest.fixture(scope="session")
def inflation_run(twin_runs: TwinRuns, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("inflation") / "inflation.h5"
    return write(path, twin_runs.inflation(PRESSURES_KPA))
