from pathlib import Path

import pytest

from bscd.acquisition import RunFile
from bscd.procedures import Observations, ScanRecipe, observe, record_scan, record_validation
from tests.procedures.twin_rig import TARGET, TwinRig

REFERENCE = ScanRecipe(kind="reference", positions=5, step_mm=4.0, frames_per_position=1)
BSC = ScanRecipe(kind="bsc", positions=5, step_mm=4.0, frames_per_position=1)


@pytest.fixture
def twin() -> TwinRig:
    return TwinRig()


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A reference scan, a biprism scan and a validation scan of five positions, on one rig."""
    folder = tmp_path_factory.mktemp("scans")
    paths = {name: folder / f"{name}.h5" for name in ("reference", "bsc", "validation")}
    twin = TwinRig()
    record_scan(twin.rig, REFERENCE, TARGET, paths["reference"], config_text="[target]\nrows = 23\n")
    record_scan(twin.rig, BSC, TARGET, paths["bsc"], config_text="[target]\nrows = 23\n")
    record_validation(twin.rig, BSC, TARGET, paths["validation"])
    return paths


@pytest.fixture
def runs(recorded: dict[str, Path]):
    opened = {name: RunFile(path) for name, path in recorded.items()}
    yield opened
    for run in opened.values():
        run.close()


@pytest.fixture(scope="session")
def observed(recorded: dict[str, Path]) -> dict[str, Observations]:
    """The dots of the reference scan and of the biprism scan."""
    with RunFile(recorded["reference"]) as reference, RunFile(recorded["bsc"]) as bsc:
        return {"reference": observe(reference, TARGET, "reference"), "bsc": observe(bsc, TARGET, "bsc")}
