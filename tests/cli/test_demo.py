"""The demo: what it writes, and that from rendered images at 2 grey levels it reaches the floor."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.calibration import Calibration
from bscd.cli.app import run
from bscd.cli.demo import DEFAULT_CONFIG
from bscd.cli.demo.run import run_demo
from bscd.cli.demo.summary import told
from bscd.config import parse_config
from bscd.errors import InputError
from bscd.results import ResultsFile
from drivers.twin.membrane import Membrane
from tests.analysis.test_report_page import Page

#: The fixture runs within the first test's time.
pytestmark = pytest.mark.timeout(900)


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
    assert 0.2 < demo.volume.face_pose.mean() < 0.8  # both poses that were scanned
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
    assert set(summary) == {"reference", "bsc_pos0", "volume", "sphere", "inflation"}
    assert set(summary["sphere"]) == {"radius", "uncorrected", "corrected", "truth_uncorrected", "truth_corrected"}
    recorded, measured = {"frames", "fps", "dropped"}, {"points", "live_fps", "w_max"}
    assert set(summary["inflation"]) == {*recorded, *measured, "truth_w_rms", "truth_worst", "kept_worst"}
    assert set(summary["bsc_pos0"]) == {"uncorrected", "corrected"}
    assert set(summary["volume"]) == {"uncorrected", "corrected", "truth_corrected", "truth_floor"}
    assert summary["volume"]["truth_corrected"]["mean"] == demo.volume.figure("corrected", "truth").mean_mm


def test_folder_holds_report_runs_and_calibration(demo):
    assert "<svg" in (demo.folder / "report.html").read_text()
    assert list((demo.folder / "figures").glob("*.png"))
    assert Calibration.load(demo.folder / "calibration.h5").figures["positions"] == 17.0
    for name in ("reference", "bsc", "pos0", "between", "sphere", "inflation"):
        assert (demo.folder / f"{name}.h5").is_file()


def test_the_sphere(demo):
    sphere = demo.summary["sphere"]
    assert abs(sphere["radius"] - 18.265) <= 0.01
    assert abs(sphere["corrected"]["mean"]) <= 5.6e-4
    assert sphere["corrected"]["std"] <= 0.012
    assert sphere["uncorrected"]["std"] > 3.0 * sphere["corrected"]["std"]
    assert abs(sphere["truth_corrected"]["mean"]) <= 0.005
    assert sphere["truth_corrected"]["std"] <= 0.012
    assert sphere["truth_uncorrected"]["std"] > 3.0 * sphere["truth_corrected"]["std"]


def test_the_inflation_is_recorded_at_11_fps_without_a_lost_frame(demo):
    inflation = demo.summary["inflation"]
    assert inflation["frames"] >= 60
    assert inflation["dropped"] == 0
    assert inflation["fps"] == pytest.approx(11.0, rel=1e-3)
    with RunFile(demo.folder / "inflation.h5") as recorded:
        table = recorded.table("primary", "inflation")
        assert recorded.complete
    assert len(table) == inflation["frames"]
    assert (np.diff(table["frame_id"]) == 1).all()
    assert np.allclose(np.diff(table["time_s"]), 1.0 / 11.0, atol=1e-6)
    assert np.abs(table["pressure_kpa"][:16] - 0.05).max() < 0.03
    assert table["pressure_kpa"].max() == pytest.approx(16.0, abs=0.05)


def test_the_inflation_is_measured_to_the_truth(demo):
    inflation = demo.summary["inflation"]
    assert inflation["truth_w_rms"] <= inflation["truth_worst"]["w"] <= 0.012  # at every frame
    assert inflation["truth_worst"]["u"] <= 0.005
    assert inflation["truth_worst"]["v"] <= 0.005
    assert inflation["kept_worst"] >= 0.98
    assert inflation["live_fps"] > 0.5
    membrane = Membrane(parse_config(DEFAULT_CONFIG.read_text()).twin.membrane)
    with ResultsFile(demo.folder / "inflation-result.h5") as results:
        assert len(results) == inflation["frames"]
        assert len(results.points_px) == inflation["points"] > 2000
        highest = results.array("pressure_kpa").max()
        w = np.where(results.array("status") == 0, results.array("uvw_mm")[..., 2], np.nan)
    assert inflation["w_max"] == np.nanmax(w)
    # the largest of some hundred points near the pole, each with a noise of 5 um
    assert inflation["w_max"] == pytest.approx(membrane.rise_mm(highest) - membrane.rise_mm(0.05), abs=0.03)


def test_the_report_has_calibration_and_measurement_and_nothing_from_elsewhere(demo):
    text = (demo.folder / "report.html").read_text()
    page = Page(text)
    figures = (
        *("error_map_pos0", "distortion_maps", "sphere_deviation", "sphere_beside_standard", "sphere_sigma"),
        *(f"inflation_{name}" for name in ("displacement", "curves", "strain", "sigma", "noise")),
    )
    for name in figures:
        assert f"figure-{name}" in page.ids
        assert (demo.folder / "figures" / f"{name}.png").is_file()
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert not re.search(r"https?:|<script|@import", text)
    assert all(reference.startswith(("#", "data:image/")) for reference in page.references)
    assert len(text) < 8e6
    measured = {row[0]: row[1] for row in page.tables["table-measured"]}
    corrected = measured["Sphere, radial deviation, biprism, after correction"].removesuffix(" mm").split(" ± ")
    sphere = demo.summary["sphere"]["corrected"]
    assert np.allclose([float(value) for value in corrected], [sphere["mean"], sphere["std"]], atol=6e-6)
    noise = {row[0]: row[3] for row in page.tables["table-practice-noise-floor"]}
    assert noise["Taken from"].endswith("frames at rest that the reference is not made of")
    hardware = {row[0]: row[1:] for row in page.tables["table-practice-hardware"]}
    assert hardware["Frame rate"] == ["not recorded", "not recorded", "11.0 frames/s"]
    assert float(hardware["Stereo angle"][1].split()[0]) == pytest.approx(20.0, abs=0.2)
    runs = {row[0] for row in page.tables["table-runs"]}
    assert {"sphere.h5", "inflation.h5"} <= runs


def test_all_figures_are_told_beside_the_papers(demo):
    text = "\n".join(told(demo.summary))
    for words in (
        "paper 0.32",
        "paper 0.00056",
        "paper 18.265",
        "paper about 6 at 13 kPa",
        "paper 11 fps",
        "0 dropped",
    ):
        assert words in text
    assert f"{demo.summary['inflation']['truth_w_rms']:.4f} mm rms" in text
    assert f"{demo.summary['inflation']['truth_worst']['w']:.4f} mm rms in w" in text
    uncorrected = demo.summary["sphere"]["truth_uncorrected"]
    assert re.search(rf"sphere, uncorrected, about truth +{uncorrected['mean']:.4f} \+- {uncorrected['std']:.4f}", text)


def test_without_a_pressure_source_nothing_is_begun(tmp_path):
    text = DEFAULT_CONFIG.read_text().replace('[devices.pressure]\ndriver = "pressure.simulated"\n', "")
    with pytest.raises(InputError, match=r"needs a \[devices.pressure\] section"):
        run_demo(tmp_path / "out", text)
    assert not (tmp_path / "out").exists()


def test_offline_calibration_of_the_demos_runs_is_the_same(demo, tmp_path):
    out = tmp_path / "again.h5"
    assert run(["calibrate", str(demo.folder / "reference.h5"), str(demo.folder / "bsc.h5"), "-o", str(out)]) == 0
    assert Calibration.load(out).checksum == demo.calibration.checksum


def test_other_peoples_folders_are_left_alone(tmp_path: Path, capsys):
    (tmp_path / "thesis.tex").write_text("mine")
    assert run(["demo", "--out", str(tmp_path)]) == 1
    assert "no demo made" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
