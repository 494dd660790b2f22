"""The tutorial does what it says, from nothing but its own twin."""

import os
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

import bscd

TUTORIAL = Path(__file__).resolve().parents[2] / "docs/tutorial.py"


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """What it printed, and the folder that it filled."""
    place = tmp_path_factory.mktemp("tutorial")
    command = [sys.executable, "-W", "error", TUTORIAL]
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    told = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, timeout=170)
    assert told.returncode == 0, told.stderr
    return told.stdout, place / "tutorial-data"


def test_the_sphere_comes_out_as_it_is(done):
    radius_mm, nominal_mm = re.search(r"radius ([\d.]+) mm, nominal ([\d.]+) mm", done[0]).groups()
    mean_mm, std_mm = re.search(r"nominal sphere: ([-+\d.]+) \+- ([\d.]+) mm", done[0]).groups()
    assert abs(float(radius_mm) - float(nominal_mm)) < 0.02
    assert abs(float(mean_mm)) < 0.005
    assert float(std_mm) < 0.02


def test_strain_rises_with_the_pressure(done):
    table = np.genfromtxt(done[1] / "by_frame.csv", delimiter=",", names=True)
    assert len(table) > 10
    ramp = table[table["pressure_kpa"] > 0.1]
    assert ramp["pressure_kpa"][-1] > 8.0
    for name in ("pressure_kpa", "w_mm", "e1", "e2"):
        assert (np.diff(ramp[name]) > 0.0).all(), name
    assert 3.5 < ramp["w_mm"][-1] < 5.5
    assert 0.0 < ramp["e2"][-1] < ramp["e1"][-1] < 0.15


def test_what_it_leaves_can_be_opened(done):
    folder = done[1]
    with bscd.open_results(folder / "results.h5") as results:
        assert results.results.verify() is None
        assert results.counts.text(results.status_names) in done[0]
    picture = matplotlib.image.imread(folder / "strain_over_pressure.png")
    assert picture.shape[1] > 1000
    assert picture[..., :3].std() > 0.05
    assert len(list((folder / "paraview").glob("*.vtu"))) == len(results)


def test_its_cells_are_words_or_code():
    """Jupyter and others take `# %%` for code and `# %% [markdown]` for words, which are comments all through."""
    cells = re.split(r"(?m)^# %%", TUTORIAL.read_text())
    assert cells[0] == ""
    words = [cell for cell in cells if cell.startswith(" [markdown]")]
    assert len(words) >= 8
    for cell in words:
        assert all(line.startswith("#") for line in cell.splitlines()[1:] if line)
    for cell in cells[1:]:
        if cell not in words:
            compile(cell.partition("\n")[2], "cell", "exec")
