"""`bscd.calibrate`: from run files to a calibration in one call."""

from pathlib import Path

import numpy as np
import pytest

import bscd
from bscd.calibration import Calibration
from bscd.errors import InputError
from bscd.procedures import ScanRecipe, record_scan
from tests.procedures.twin_rig import TARGET, TwinRig


@pytest.fixture(scope="module")
def scans(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("scans")
    twin = TwinRig()
    for kind in ("reference", "bsc"):
        recipe = ScanRecipe(kind=kind, positions=5, step_mm=4.0, frames_per_position=1)
        record_scan(twin.rig, recipe, TARGET, folder / f"{kind}.h5", config_text="[target]\nrows = 23\n")
    return folder


def test_what_is_kept_is_what_is_returned(scans: Path, tmp_path):
    with pytest.warns(UserWarning) as said:
        made = bscd.calibrate(scans / "reference.h5", scans / "bsc.h5", out=tmp_path / "cal.h5", degree=3)
    assert any("does not give [target] columns; 9 is taken" in str(warning.message) for warning in said)
    kept = Calibration.load(tmp_path / "cal.h5")
    assert kept.checksum == made.checksum
    assert made.choices.degree == 3
    control = made.control
    points = made.reconstruct(control.left_px[:50], control.right_px[:50])
    assert np.abs(points.xyz_mm - control.reference_mm[:50]).max() < 0.1


def test_refused(scans: Path, tmp_path):
    (tmp_path / "cal.h5").touch()
    with pytest.raises(InputError, match="never overwritten"):
        bscd.calibrate(scans / "reference.h5", scans / "bsc.h5", out=tmp_path / "cal.h5")
    with pytest.raises(TypeError, match="maps"):
        bscd.calibrate(scans / "reference.h5", scans / "bsc.h5", maps="linear")
    with pytest.raises(InputError, match="does not exist"):
        bscd.calibrate(scans / "none.h5", scans / "bsc.h5")
