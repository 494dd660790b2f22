"""The demo: what it writes, and that from rendered images at 2 grey levels it reaches the floor."""

import json
from pathlib import Path

import numpy as np
import pytest

from bscd.calibration import Calibration
from bscd.cli.app import run
from bscd.cli.demo import DEFAULT_CONFIG, run_demo


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    out = tmp_path_factory.mktemp("demo") / "out"
    return run_demo(out, DEFAULT_CONFIG.read_text(), str(DEFAULT_CONFIG))


def test_standard_stereo_and_the_papers_uncorrected_error(demo):
    assert demo.summary["reference"]["mean"] <= 0.01
    assert demo.summary["bsc_pos0"]["uncorrected"]["mean"] == pytest.approx(0.17, rel=0.15)


def test_the_correction_reaches_the_floor_over_the_hull_and_in_each_third(demo):
    whole = np.ones(len(demo.volume.index), bool)
    assert demo.volume.inside.mean() > 0.9
    for where in (whole, *(demo.volume.depth_third(third) for third in range(3))):
        corrected = demo.volume.figure("corrected", "truth", where)
        floor = demo.volume.figure("floor", "truth", where)
        assert corrected.count > 500
        assert corrected.mean_mm <= 1.1 * floor.mean_mm
        assert corrected.mean_mm <= 0.015


def test_sigma_covers_the_true_errors(demo):
    inside = demo.volume.inside
    error = np.abs(demo.volume.corrected_mm - demo.volume.truth_mm)[inside]
    share = np.mean(error < demo.volume.sigma_mm[inside], axis=0)
    assert np.all(np.abs(share - 0.68) < 0.07), share


def test_summary_file_has_the_figures(demo):
    summary = json.loads((demo.folder / "summary.json").read_text())
    assert summary == demo.summary
    assert set(summary) == {"reference", "bsc_pos0", "volume"}
    assert set(summary["bsc_pos0"]) == {"uncorrected", "corrected"}
    assert set(summary["volume"]) == {"uncorrected", "corrected", "truth_corrected", "truth_floor"}
    assert summary["volume"]["truth_corrected"]["mean"] == demo.volume.figure("corrected", "truth").mean_mm


def test_folder_holds_report_runs_and_calibration(demo):
    assert "<svg" in (demo.folder / "report.html").read_text()
    assert list((demo.folder / "figures").glob("*.png"))
    assert Calibration.load(demo.folder / "calibration.h5").figures["positions"] == 17.0
    for name in ("reference", "bsc", "pos0", "between"):
        assert (demo.folder / f"{name}.h5").is_file()


def test_offline_calibration_of_the_demos_runs_is_the_same(demo, tmp_path):
    out = tmp_path / "again.h5"
    assert run(["calibrate", str(demo.folder / "reference.h5"), str(demo.folder / "bsc.h5"), "-o", str(out)]) == 0
    assert Calibration.load(out).checksum == demo.calibration.checksum


def test_other_peoples_folders_are_left_alone(tmp_path: Path, capsys):
    (tmp_path / "thesis.tex").write_text("mine")
    assert run(["demo", "--out", str(tmp_path)]) == 1
    assert "no demo made" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
