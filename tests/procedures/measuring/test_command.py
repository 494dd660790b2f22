"""`bscd measure`, from run and calibration to a results file."""

import cv2
import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.calibration import Calibration
from bscd.cli.app import run
from bscd.procedures.measuring import MeasureSettings, PointStatus, measure_run
from bscd.results import ResultsFile
from tests.procedures.measuring.twin_runs import REST_KPA, TwinRuns, narrowed, write
from tests.results.measured import same


@pytest.fixture(scope="module")
def files(wide: Calibration, twin_runs: TwinRuns, tmp_path_factory):
    folder = tmp_path_factory.mktemp("measure")
    wide.save(folder / "cal.h5")
    write(folder / "run.h5", twin_runs.inflation((REST_KPA, REST_KPA, 1.8)))
    return folder


def measure(files, *more, cal="cal.h5", source="run.h5", out="result.h5"):
    return run(["measure", str(files / cal), str(files / source), "-o", str(files / out), "--step", "25", *more])


@pytest.fixture(scope="module")
def result(files):
    assert measure(files) == 0
    return files / "result.h5"


def test_what_is_written_is_what_was_measured(files, result, wide):
    with RunFile(files / "run.h5") as source, ResultsFile(result) as results:
        measurement = measure_run(wide, source, MeasureSettings(step_px=25))
        assert results.complete
        assert results.verify() is None
        for frame, again in zip(results.frames(), measurement.frames, strict=True):
            for name in ("xyz_mm", "displacement_mm", "uvw_mm", "status", "left_px", "right_px"):
                assert np.allclose(getattr(frame, name), getattr(again, name), rtol=1e-6, atol=1e-6, equal_nan=True)
        header = results.header
        assert header.run.uuid == source.uuid
        assert header.run.checksum == source.checksum
        assert header.calibration.checksum == wide.checksum
        assert header.calibration.file_name == "cal.h5"
        assert header.reference_frames == (0, 1)
        assert header.stereo == "biprism"
        assert header.parameters["step_px"] == 25
        assert header.parameters["tracking_shape"] == "curved"
        assert header.status_names[9] == "outside_volume"
        assert np.allclose(header.membrane.axes, measurement.frame.axes)


def test_the_same_again_gives_the_same(files, result):
    assert measure(files, "--threads", "1", out="again.h5") == 0
    with ResultsFile(result) as one, ResultsFile(files / "again.h5") as other:
        assert all(same(a, b) for a, b in zip(one.frames(), other.frames(), strict=True))


def test_options(files, result, capsys):
    mask = np.zeros((1024, 1280), np.uint8)
    mask[400:600, 250:450] = 255
    cv2.imwrite(str(files / "region.png"), mask)
    assert measure(files, "--region", str(files / "region.png"), "--no-strain", "--no-corrected", out="some.h5") == 0
    assert "some.h5: " in capsys.readouterr().out
    with ResultsFile(files / "some.h5") as some:
        assert ((some.points_px >= [250, 400]) & (some.points_px < [450, 600])).all()
        assert some.header.parameters["corrected"] is False
        assert np.isnan(some.array("strain")).all()
        assert np.isfinite(some.array("uvw_mm")).any()


def test_what_became_of_the_points_is_told_apart(files, wide, capsys):
    narrowed(wide).save(files / "narrow.h5")
    for name, more in (("inside.h5", ()), ("beyond.h5", ("--extrapolate",))):
        assert measure(files, *more, cal="narrow.h5", out=name) == 0
        told = capsys.readouterr().out.splitlines()[-1]
        with ResultsFile(files / name) as results:
            status, known = results.array("status"), np.isfinite(results.array("xyz_mm")).all(axis=2)
            extrapolated = int((known & (status != 0)).sum())
            valid, lost = int((status == 0).sum()), int((~known).sum())
            outside = int((status == PointStatus.OUTSIDE_VOLUME).sum())
        assert f"3 inflation frames of {status.shape[1]} points: {valid} valid (" in told
        assert f"%), {extrapolated} extrapolated, {lost} lost" in told
        assert (extrapolated == outside > 50) if more else (extrapolated == 0)
        assert (f"{outside} outside_volume" in told) is (not more)


def test_it_never_overwrites(files, result, capsys):
    before = result.read_bytes()
    assert measure(files) == 1
    assert (
        one_sentence(capsys) == f"error: {result}: exists already; results are never overwritten, choose another name"
    )
    assert result.read_bytes() == before


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ({"cal": "missing.h5"}, "missing.h5"),
        ({"source": "missing.h5"}, "missing.h5"),
        ({"cal": "run.h5"}, "run.h5"),
        ({"source": "cal.h5"}, "cal.h5"),
        ({"source": "cut.h5"}, "cut.h5"),
    ],
    ids=["no calibration", "no run", "a run as calibration", "a calibration as run", "a truncated run"],
)
def test_files_that_are_not_what_they_should_be(files, capsys, names, said):
    (files / "cut.h5").write_bytes((files / "run.h5").read_bytes()[:200_000])
    assert measure(files, out="none.h5", **names) == 1
    told = one_sentence(capsys)
    assert told.startswith("error: ")
    assert said in told
    assert not (files / "none.h5").exists()


@pytest.mark.parametrize("more", [("--stereo", "standard"), ("--phase", "sphere"), ("--subset", "20"), ("--vsg", "-1")])
def test_what_can_not_be_measured(files, capsys, more):
    assert measure(files, *more, out="none.h5") == 1
    assert one_sentence(capsys).startswith("error: ")
    assert not (files / "none.h5").exists()


@pytest.mark.parametrize(
    "arguments",
    [["measure"], ["measure", "a.h5", "b.h5"], ["measure", "a.h5", "b.h5", "-o", "c.h5", "--stereo-shape", "cubic"]],
)
def test_bad_usage(arguments, capsys):
    assert run(arguments) == 2
    assert "Traceback" not in capsys.readouterr().err


def one_sentence(capsys) -> str:
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error")]
    assert len(lines) == 1
    return lines[0]
