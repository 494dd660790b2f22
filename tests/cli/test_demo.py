"""The demo, shortened to five positions: what it writes, and that its figures are the twin's."""

import json
from pathlib import Path

import pytest

from bscd.calibration import Calibration
from bscd.cli.app import run

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    text = (ROOT / "config/twin.toml").read_text()
    short = text.replace("positions = 17", "positions = 5").replace("step_mm = 2.0", "step_mm = 8.0")
    short = short.replace("frames_per_position = 2", "frames_per_position = 1")
    assert short != text
    (folder / "twin.toml").write_text(short)
    out = folder / "out"
    assert run(["demo", "--out", str(out), "--config", str(folder / "twin.toml")]) == 0
    return out


def test_summary_has_the_figures(made):
    summary = json.loads((made / "summary.json").read_text())
    assert set(summary) == {"reference", "bsc_pos0", "volume"}
    assert set(summary["volume"]) == {"uncorrected", "corrected", "truth_corrected", "truth_floor"}
    volume = summary["volume"]
    assert summary["reference"]["mean"] <= 0.01
    assert summary["bsc_pos0"]["uncorrected"]["mean"] == pytest.approx(0.17, rel=0.15)
    assert volume["truth_corrected"]["mean"] <= 0.015
    assert volume["truth_floor"]["mean"] < volume["truth_corrected"]["mean"] * 1.001
    assert volume["truth_corrected"]["mean"] <= 1.2 * volume["truth_floor"]["mean"]  # five positions of 17


def test_folder_holds_report_runs_and_calibration(made):
    assert "<svg" in (made / "report.html").read_text()
    assert list((made / "figures").glob("*.png"))
    assert Calibration.load(made / "calibration.h5").figures["positions"] == 5.0
    for name in ("reference", "bsc", "pos0", "between"):
        assert (made / f"{name}.h5").is_file()


def test_other_peoples_folders_are_left_alone(tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("mine")
    assert run(["demo", "--out", str(tmp_path)]) == 1
    assert "no demo made" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_offline_calibration_of_the_demos_runs_is_the_same(made, tmp_path):
    out = tmp_path / "again.h5"
    assert run(["calibrate", str(made / "reference.h5"), str(made / "bsc.h5"), "-o", str(out)]) == 0
    assert Calibration.load(out).checksum == Calibration.load(made / "calibration.h5").checksum
