"""`bscd measure --report`: what the page says of twin runs, against values computed another way."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares

from bscd.acquisition import CameraMeta, RunFile, RunWriter
from bscd.analysis.report import MeasurementReport, write_measurement_report
from bscd.calibration import Calibration
from bscd.cli.app import run
from bscd.procedures.measuring import MeasureSettings, measure_run
from bscd.procedures.reporting import Source, gather_measurement
from bscd.results import ResultsFile
from tests.analysis.test_report_page import Page
from tests.procedures.measuring.twin_runs import CAMERA, REST_KPA, TwinRuns

CONFIG = """
[sphere]
radius_mm = 18.265
[lens]
description = "zoom <75 mm>"
[light]
wavelength_nm = 630
[pattern]
technique = "airbrush"
"""
PRESSURES = (*[REST_KPA] * 4, 4.0, 8.0, 13.0, 16.0)
SETTINGS = MeasureSettings(step_px=20)


def write_run(path, frames, cameras=("primary",), config=CONFIG, **changes):
    camera = CameraMeta(CAMERA.width_px, CAMERA.height_px, 8, 0.0067, "Acme", "M1", "42")
    with RunWriter(path, title=path.stem, cameras=dict.fromkeys(cameras, camera), config_text=config) as writer:
        for frame in frames:
            writer.append(replace(frame, exposure_s=0.02, gain_db=0.0, **changes))
    return path


def measured(folder, name, *more):
    """The command's results and page."""
    out, page = folder / f"{name}-{len(more)}-result.h5", folder / f"{name}-{len(more)}-report"
    files = [str(folder / "cal.h5"), str(folder / f"{name}.h5")]
    assert run(["measure", *files, "-o", str(out), "--step", "20", "--report", str(page), *more]) == 0
    return out, page


@pytest.fixture(scope="module")
def folder(wide: Calibration, twin_runs: TwinRuns, tmp_path_factory):
    folder = tmp_path_factory.mktemp("reported")
    wide.save(folder / "cal.h5")
    write_run(folder / "sphere.h5", twin_runs.sphere(), ("primary", "auxiliary"))
    write_run(folder / "inflation.h5", twin_runs.inflation(PRESSURES))
    return folder


@pytest.fixture(scope="module")
def sphere(folder):
    return measured(folder, "sphere")


@pytest.fixture(scope="module")
def inflation(folder):
    return measured(folder, "inflation")


def page_of(folder) -> Page:
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def cells(page: Page, name: str) -> dict[str, list[str]]:
    return {row[0]: row[1:] for row in page.tables[f"table-{name}"]}


def deviation(cell: str) -> tuple[float, float]:
    mean, std = cell.removesuffix(" mm").split(" ± ")
    return float(mean), float(std)


def about_nominal(xyz, radius=18.265):
    """Deviations of all points from the sphere of this radius, fitted by plain least squares to those near it."""
    kept = xyz
    for _ in range(6):
        start = kept.mean(axis=0) + [0.0, radius, 0.0]
        centre = least_squares(lambda c, x: np.linalg.norm(x - c, axis=1) - radius, start, args=(kept,)).x
        away = np.linalg.norm(xyz - centre, axis=1) - radius
        kept = xyz[np.abs(away) < 3.5 * 1.4826 * np.median(np.abs(away))]
    return (kept_mean_std(away), (away.mean(), away.std()))


def kept_mean_std(away):
    kept = away[np.abs(away) < 4.7 * 1.4826 * np.median(np.abs(away))]
    return kept.mean(), kept.std()


@pytest.mark.parametrize("which", ["sphere", "inflation"])
def test_the_page_is_whole_in_itself(request, which):
    _, folder = request.getfixturevalue(which)
    text = (folder / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert not re.search(r"https?:|<script|@import", text)
    assert all(reference.startswith(("#", "data:image/")) for reference in page.references)
    assert {r[1:] for r in page.references if r.startswith("#")} <= set(page.ids)
    assert not re.search(r"\b(nan|NaN|inf|None)\b", " ".join(page.words))
    for name in (id_.removeprefix("figure-") for id_ in page.ids if id_.startswith("figure-")):
        image = cv2.imread(str(folder / "figures" / f"{name}.png"))
        assert image.std() > 5.0
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", text, re.DOTALL)
    assert len(captions) == text.count("<svg")
    assert min(map(len, captions)) > 80


class TestSphere:
    def test_has_its_figures(self, sphere):
        shown = {"sphere_deviation", "sphere_beside_standard", "sphere_sigma"}
        assert {f"figure-{name}" for name in shown} <= set(page_of(sphere[1]).ids)

    def test_after_the_correction(self, sphere):
        with ResultsFile(sphere[0]) as results:
            frame = results.frame(1)
        expected = about_nominal(frame.xyz_mm[frame.valid])
        merits = cells(page_of(sphere[1]), "merits")
        kept = deviation(merits["Radial deviation, radius fixed at 18.265 mm"][1])
        everything = deviation(merits["The same with outliers, all valid points"][1])
        assert np.allclose(kept, expected[0], atol=3e-4)
        assert np.allclose(everything, expected[1], atol=3e-4)
        assert abs(kept[0]) <= 5.6e-4
        assert 0 < int(merits["Outliers to which the fit gave no weight"][1]) < 0.08 * frame.valid.sum()

    def test_before_it_is_what_the_virtual_cameras_alone_measure(self, sphere, folder, wide: Calibration):
        with RunFile(folder / "sphere.h5") as source:
            raw = list(measure_run(wide, source, replace(SETTINGS, corrected=False)).frames)[1]
        expected = about_nominal(raw.xyz_mm[raw.valid])
        row = cells(page_of(sphere[1]), "merits")["Radial deviation, radius fixed at 18.265 mm"]
        assert np.allclose(deviation(row[0]), expected[0], atol=2e-3)
        assert deviation(row[0])[1] > 3.0 * deviation(row[1])[1]

    def test_the_standard_pair_is_measured_beside_it(self, sphere, folder, wide: Calibration):
        with RunFile(folder / "sphere.h5") as source:
            pair = list(measure_run(wide, source, replace(SETTINGS, stereo="standard", phase="sphere")).frames)[1]
        merits = cells(page_of(sphere[1]), "merits")
        assert merits["quantity"] == ["biprism, before correction", "biprism, after correction", "standard pair"]
        expected = about_nominal(pair.xyz_mm[pair.valid])
        row = merits["Radial deviation, radius fixed at 18.265 mm"]
        assert np.allclose(deviation(row[2]), expected[0], atol=3e-4)
        assert merits["Points measured, of those with texture"][2] == f"{pair.valid.sum()} of {len(pair.valid)}"
        assert float(merits["Stereo angle"][2].split()[0]) == pytest.approx(20.0, abs=0.2)
        depth = float(merits["Stated sigma of x, y (depth), z, median"][2].split(", ")[1])
        assert depth == pytest.approx(1e3 * np.median(pair.sigma_mm[pair.valid, 1]), rel=0.06)
        area = [float(cell.split()[0]) for cell in merits["Seen area"]]
        assert area[1] == pytest.approx(area[0], rel=0.02)
        assert 600.0 < area[2] < area[1]

    def test_every_point_is_accounted_for(self, sphere):
        with ResultsFile(sphere[0]) as results:
            frame, names = results.frame(1), results.header.status_names
        shown = cells(page_of(sphere[1]), "validity")
        assert int(shown["valid"][0]) == frame.valid.sum()
        for code, name in names.items():
            if code:
                expected = np.count_nonzero(frame.status == code)
                assert int(shown.get(name.replace("_", " "), ["0"])[0]) == expected
        assert sum(int(row[0]) for name, row in shown.items() if name != "points") == len(frame.status)

    def test_without_a_nominal_radius_and_a_second_camera(self, folder, twin_runs: TwinRuns):
        frames = [frame for frame in twin_runs.sphere() if frame.jack_mm > 60.0]
        write_run(folder / "alone.h5", frames, config="")
        page = page_of(measured(folder, "alone")[1])
        merits = cells(page, "merits")
        assert merits["quantity"] == ["biprism, before correction", "biprism, after correction"]
        assert not any("fixed" in name for name in merits)
        assert float(merits["Radius, free"][1].split(" ± ")[0]) == pytest.approx(18.265, abs=0.01)
        assert "figure-sphere_beside_standard" not in page.ids
        assert "nominal radius is not known" in " ".join(" ".join(page.words).split())

    def test_a_folder_that_is_a_file_is_refused_before_anything_is_measured(self, folder, capsys):
        files = [str(folder / "cal.h5"), str(folder / "sphere.h5"), "-o", str(folder / "none.h5")]
        assert run(["measure", *files, "--report", str(folder / "cal.h5")]) == 1
        assert "is a file; name a folder" in capsys.readouterr().err
        assert not (folder / "none.h5").exists()


class TestInflation:
    def test_has_its_figures(self, inflation):
        names = ("displacement", "curves", "strain", "sigma", "noise")
        assert {f"figure-inflation_{name}" for name in names} <= set(page_of(inflation[1]).ids)

    def test_figures_beside_the_papers(self, inflation, twin_runs: TwinRuns):
        with ResultsFile(inflation[0]) as results:
            w = np.where(results.array("status") == 0, results.array("uvw_mm")[..., 2], np.nan)
        rise = {
            kpa: twin_runs.world.surface_positions(np.zeros((1, 2)), twin_runs.inflated(kpa))[0]
            for kpa in (REST_KPA, 13.0)
        }
        shown = cells(page_of(inflation[1]), "measured")
        assert float(shown["Membrane, largest w"][0].split()[0]) == pytest.approx(np.nanmax(w), abs=0.005)
        middle = shown["Membrane, w in the middle at 13 kPa, since the reference"]
        assert float(middle[0].split()[0]) == pytest.approx(np.linalg.norm(rise[13.0] - rise[REST_KPA]), abs=0.03)
        assert middle[1] == "about 6 mm"
        assert shown["Membrane, frames"][0] == "8, 0 lost between them"
        assert float(shown["Membrane, frames a second"][0]) == pytest.approx(11.0)

    def test_the_good_practices_table(self, inflation, wide: Calibration):
        page = page_of(inflation[1])
        hardware, analysis, noise = (
            {name: row[0] for name, row in cells(page, f"practice-{part}").items()}
            for part in ("hardware", "analysis", "noise-floor")
        )
        with ResultsFile(inflation[0]) as results:
            parameters, points = results.header.parameters, len(results.points_px)
            strain = results.array("strain")[:4].astype(float)
            w = results.array("uvw_mm")[:4, :, 2]
            valid = results.array("status")[:4] == 0
        assert hardware["Camera"] == "Acme M1 (42)"
        assert hardware["Image resolution"] == "1280 x 1024 px, 8 bit, 640 x 1024 px a view"
        assert hardware["Pixel size"] == "6.70 µm"
        assert hardware["Lens"] == "zoom <75 mm>"
        assert hardware["Light"] == "630 ± 10 nm"
        assert hardware["Pattern technique"] == "airbrush"
        assert hardware["Aperture"] == "not recorded"
        assert hardware["Exposure"] == "20.0 ms"
        assert hardware["Gain"] == "0 dB"
        assert hardware["Frame rate"] == "11.0 frames/s"
        scale = float(hardware["Image scale"].split()[0])
        assert scale == pytest.approx(parameters["mm_per_px"], rel=0.01)
        width, height = (float(value) for value in re.findall(r"[\d.]+", hardware["Field of view"]))
        assert width == pytest.approx(640 * scale, rel=0.01)
        assert height == pytest.approx(1024 * scale, rel=0.01)
        # the deviation of thin prisms: 2 (n - 1) (180 - alpha) / 2, and nearer from the object than from the prism
        assert 5.0 < float(hardware["Stereo angle"].split()[0]) < 6.5
        assert 580.0 < float(hardware["Stand-off distance"].split()[0]) < 660.0
        feature_px, feature_mm = (float(v) for v in re.findall(r"[\d.]+", hardware["Pattern feature size"]))
        assert 3.0 < feature_px < 8.0
        assert feature_mm == pytest.approx(feature_px * scale, rel=0.01)
        assert analysis["Subset"].startswith("21 px")
        assert analysis["Step"].startswith("20 px")
        assert analysis["Interpolation"] == "quintic B-spline"
        assert analysis["Criterion"] == "ZNSSD, IC-GN"
        assert analysis["Points"] == f"{points}"
        assert analysis["Frames averaged for the reference"] == "4 (numbers 0 to 3)"
        assert analysis["Virtual strain gauge"].endswith(f"{parameters['vsg_mm']:.2f} mm")
        assert analysis["Temporal resolution"] == "90.9 ms between frames"
        assert noise["Taken from"].startswith("the 4 frames that the reference is made of")
        factor = np.sqrt((1 + 1 / 4) / (1 - 1 / 4))
        w = np.where(valid, w, np.nan)
        spatial = np.sqrt(np.nanmean((w - np.nanmean(w, axis=1, keepdims=True)) ** 2))
        reported = re.findall(r"[\d.]+", noise["Displacement u, v, w"])
        assert float(reported[2]) == pytest.approx(1e3 * factor * spatial, rel=0.06)
        exx = np.where(valid, strain[..., 0], np.nan)
        spatial = np.sqrt(np.nanmean((exx - np.nanmean(exx, axis=1, keepdims=True)) ** 2))
        reported = re.findall(r"[\d.]+", noise["Strain exx, eyy, exy"])
        assert float(reported[0]) == pytest.approx(1e6 * factor * spatial, rel=0.06)
        assert "not recorded" not in (*analysis.values(), *noise.values())

    def test_what_was_not_recorded_says_so(self, folder, twin_runs: TwinRuns):
        blank = {"exposure_s": float("nan"), "pressure_kpa": float("nan"), "time_s": float("nan")}
        frames = [replace(frame, **blank) for frame in twin_runs.inflation((REST_KPA, 4.0, 8.0))]
        with RunWriter(folder / "bare.h5", title="bare", cameras={"primary": CameraMeta(1280, 1024)}) as writer:
            for frame in frames:
                writer.append(frame)
        page = page_of(measured(folder, "bare")[1])
        hardware = cells(page, "practice-hardware")
        for name in ("Camera", "Pixel size", "Lens", "Light", "Exposure", "Gain", "Frame rate", "Pattern technique"):
            assert hardware[name] == ["not recorded"], name
        assert cells(page, "practice-noise-floor")["Taken from"] == [
            "not recorded: fewer than two frames at rest; record some before the ramp"
        ]
        assert "figure-inflation_noise" not in page.ids
        assert "figure-inflation_displacement" in page.ids
        assert not re.search(r"\bnan\b", " ".join(page.words), re.IGNORECASE)

    def test_extrapolated_points_are_shown_apart(self, folder, inflation):
        page = page_of(measured(folder, "inflation", "--extrapolate")[1])
        inside = cells(page_of(inflation[1]), "validity")
        shown = cells(page, "validity")
        assert int(shown["extrapolated"][0]) > 20
        assert int(inside["extrapolated"][0]) == 0
        assert shown["valid"] == inside["valid"]
        assert "Ringed points lie outside the calibrated hull" in " ".join(page.words)
        assert "Ringed points" not in " ".join(page_of(inflation[1]).words)

    def test_a_few_points_in_a_row_are_reported_for_what_they_are(self, folder):
        region = np.zeros((1024, 1280), np.uint8)
        region[500:515, 200:300] = 255
        cv2.imwrite(str(folder / "row.png"), region)
        for name in ("inflation", "sphere"):
            page = page_of(measured(folder, name, "--region", str(folder / "row.png"))[1])
            assert cells(page, "practice-hardware")["Image scale"][0] == "not recorded"
            words = " ".join(" ".join(page.words).split())
            assert ("Too few points were measured for a membrane frame" in words) == (name == "inflation")
            assert ("no membrane frame: 5 points" in words) == (name == "inflation")  # the warning
            assert not re.search(r"\bnan\b", words, re.IGNORECASE)

    def test_results_of_another_run_or_calibration_are_refused(self, folder, inflation, sphere, wide: Calibration):
        with ResultsFile(inflation[0]) as results, RunFile(folder / "sphere.h5") as other:
            with pytest.raises(Exception, match="measured from another run"):
                Source(results, other, wide)
            moved = replace(wide, choices=replace(wide.choices, degree=3))
            with RunFile(folder / "inflation.h5") as own, pytest.raises(Exception, match="another calibration"):
                Source(results, own, moved)

    def test_the_error_on_the_twin_is_shown_where_it_is_known(self, folder, inflation, wide: Calibration, tmp_path):
        with ResultsFile(inflation[0]) as results, RunFile(folder / "inflation.h5") as source:
            errors = np.array([0.1, 0.1, 0.1, 0.1, 0.002, 0.003, 0.004, 0.009])
            data = gather_measurement([Source(results, source, wide)], truth_w_rms_mm=errors)
        write_measurement_report(MeasurementReport("known", "now", data), tmp_path)
        shown = cells(page_of(tmp_path), "measured")
        row = shown["Membrane, error of w, rms, median of frames (known on the twin)"]
        assert row[0] == "0.00350 mm, worst frame 0.00900 mm"
        assert not any("twin" in name for name in cells(page_of(inflation[1]), "measured"))
