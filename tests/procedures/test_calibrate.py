from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from bscd.acquisition import RunFile, RunWriter
from bscd.calibration import Calibration, CalibrationChoices
from bscd.errors import CheckFailedError, InputError
from bscd.procedures import (
    Observations,
    Progress,
    calibrate_observations,
    calibrate_runs,
    check_calibration,
    validate_run,
)
from tests.procedures.twin_rig import TARGET, TwinRig

CHOICES = CalibrationChoices(degree=3)


@pytest.fixture(scope="module")
def calibration(recorded: dict[str, Path]) -> Calibration:
    with RunFile(recorded["reference"]) as reference, RunFile(recorded["bsc"]) as bsc:
        now = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
        return calibrate_runs(reference, bsc, TARGET, CHOICES, now=lambda: now)


class TestCalibrate:
    def test_another_acquisition_is_reconstructed_by_it(
        self, calibration: Calibration, runs: dict[str, RunFile]
    ) -> None:
        validation = validate_run(calibration, runs["validation"], TARGET)
        # five positions through a coarse sensor: the correction has to take most of the error away
        assert validation.figure("uncorrected").mean_mm > 0.1
        assert validation.figure("corrected").mean_mm < 0.03
        assert validation.inside.sum() > 300

    def test_it_says_what_it_came_from(self, calibration: Calibration, runs: dict[str, RunFile]) -> None:
        origins = calibration.origins
        for role in ("reference", "bsc"):
            assert origins[f"{role}_uuid"] == runs[role].uuid
            assert origins[f"{role}_checksum"] == runs[role].checksum
            assert origins[f"{role}_configuration"] == "[target]\nrows = 23\n"
        assert origins["time"] == "2026-01-02T03:04:05+00:00"
        assert calibration.jack_mm == 70.0

    def test_it_is_for_images_like_those_of_its_runs(self, calibration: Calibration, runs: dict[str, RunFile]) -> None:
        assert set(calibration.image_size_px) == {"primary", "auxiliary"}
        for name, size_px in calibration.image_size_px.items():
            assert size_px == (runs["reference"].cameras[name].width_px, runs["reference"].cameras[name].height_px)

    def test_both_scans_in_one_file_give_the_same(
        self, calibration: Calibration, runs: dict[str, RunFile], tmp_path: Path
    ) -> None:
        path = tmp_path / "both.h5"
        with RunWriter(path, title="both", cameras=runs["reference"].cameras) as writer:
            for name in ("bsc", "reference"):
                for record in runs[name].frames():
                    writer.append(record)
        said: list[Progress] = []
        with RunFile(path) as both:
            again = calibrate_runs(both, both, TARGET, CHOICES, progress=said.append)
        assert np.array_equal(again.control.left_px, calibration.control.left_px)
        assert np.allclose(again.control.reference_mm, calibration.control.reference_mm)
        assert {progress.doing.split(":")[0] for progress in said} == {"reference scan", "biprism scan"}

    def test_too_few_positions(self, observed: dict[str, Observations]) -> None:
        few = replace(observed["bsc"], views=tuple(view for view in observed["bsc"].views if abs(view.position) < 2))
        with pytest.raises(InputError, match="seen at 3 positions, maps of degree 3 need at least 4"):
            calibrate_observations(observed["reference"], few, TARGET, CHOICES)

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            (lambda seen: moved(seen, 0.1), "do not belong together"),
            (lambda seen: replace(seen, jack_mm=(70.0, 70.0, 68.0)), "jacks moved from 68 to 70 mm"),
            (lambda seen: replace(seen, jack_mm=(5.0,) * 6), "raise the biprism for the one and lower it"),
            (lambda seen: replace(seen, image_size_px=(1280, 1024)), "one setting of the primary camera"),
        ],
        ids=["another mounting", "jacks moved", "jacks not raised", "another image size"],
    )
    def test_scans_that_do_not_belong_together(self, observed: dict[str, Observations], change, said: str) -> None:
        with pytest.raises(InputError, match=said):
            calibrate_observations(observed["reference"], change(observed["bsc"]), TARGET, CHOICES)

    def test_scans_without_jacks_calibrate(self, observed: dict[str, Observations]) -> None:
        unknown = replace(observed["bsc"], jack_mm=(float("nan"),) * 6)
        assert np.isnan(calibrate_observations(observed["reference"], unknown, TARGET, CHOICES).jack_mm)


def moved(seen: Observations, y_mm: float) -> Observations:
    return replace(seen, views=tuple(replace(view, y_mm=view.y_mm + y_mm) for view in seen.views))


class TestValidate:
    def test_the_calibrations_own_run_is_refused(self, calibration: Calibration, runs: dict[str, RunFile]) -> None:
        with pytest.raises(InputError, match="made from this run"):
            validate_run(calibration, runs["bsc"], TARGET)


class TestCheckCalibration:
    def test_holds_while_nothing_moved(self, calibration: Calibration, twin: TwinRig) -> None:
        check = check_calibration(twin.rig, calibration, TARGET, frames=2)
        assert not check.moved
        assert check.advice == ""
        assert check.jack_difference_mm == 0.0
        assert check.epipolar_px < check.limit_px
        assert check.dots == 414

    def test_a_prism_that_was_turned(self, calibration: Calibration) -> None:
        options = TwinRig().options
        turned = options.model_copy(update={"prism": options.prism.model_copy(update={"tilt_deg": (0.3, -0.2, 0.2)})})
        check = check_calibration(TwinRig(options=turned).rig, calibration, TARGET, frames=2)
        assert check.moved
        assert check.epipolar_px > check.limit_px
        assert "calibrate again" in check.advice

    def test_jacks_that_moved(self, calibration: Calibration, twin: TwinRig) -> None:
        twin.rig.jacks.move_to(69.0)
        check = check_calibration(twin.rig, calibration, TARGET, frames=2)
        assert check.jack_difference_mm == pytest.approx(-1.0)
        assert "-1.00 mm off" in check.advice

    def test_without_the_prism(self, calibration: Calibration, twin: TwinRig) -> None:
        twin.rig.jacks.move_to(5.0)
        with pytest.raises(CheckFailedError, match="biprism is not in the view"):
            check_calibration(twin.rig, calibration, TARGET)
