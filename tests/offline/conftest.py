from pathlib import Path

import pytest

from bscd.calibration import Calibration
from tests.procedures.measuring.twin_runs import REST_KPA, TwinRuns, wide_calibration, write


@pytest.fixture(scope="session")
def wide() -> Calibration:
    return wide_calibration()


@pytest.fixture(scope="session")
def files(wide: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with cal.h5 and run.h5, an inflation of three frames."""
    folder = tmp_path_factory.mktemp("offline")
    wide.save(folder / "cal.h5")
    runs = TwinRuns()
    write(folder / "run.h5", runs.inflation((REST_KPA, REST_KPA, 1.8)))
    runs.world.close()
    return folder
