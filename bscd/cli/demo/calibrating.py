"""The demo's calibration: both scans, the calibration, and a second acquisition that took no part in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from bscd.acquisition import PhaseName, RunFile
from bscd.analysis.report import RunOrigin
from bscd.analysis.validation import ErrorFigure
from bscd.calibration import Calibration, View
from bscd.cli.following import following
from bscd.config import RigConfig
from bscd.procedures import Rig, ScanRecipe, calibrate_observations, observe, record_scan, record_validation
from bscd.procedures.calibrate import origins_of, stage_repeatability


@dataclass(frozen=True)
class Calibrated:
    """The calibration, the runs that it came from, and the views of the reference scan."""

    calibration: Calibration
    runs: tuple[RunOrigin, ...]
    reference_views: Sequence[View]


def calibrate(rig: Rig, config: RigConfig, text: str, out: Path) -> Calibrated:
    """Scan without and with the biprism, and calibrate."""
    target = config.target.grid()
    for kind, title in (("reference", "Reference scan"), ("bsc", "Biprism scan")):
        with following(title) as progress:
            recipe = _recipe(config, kind=kind)
            record_scan(rig, recipe, target, out / f"{kind}.h5", config_text=text, progress=progress)
    with RunFile(out / "reference.h5") as reference, RunFile(out / "bsc.h5") as bsc:
        auxiliary = reference.cameras["auxiliary"]
        with following("Dots", "images") as progress:
            seen = observe(reference, target, "reference", progress=progress)
            seen_bsc = observe(bsc, target, "bsc", progress=progress)
        calibration = calibrate_observations(
            seen,
            seen_bsc,
            target,
            config.calibration.choices(),
            origins=origins_of(reference, bsc, datetime.now(UTC)),
            repeatability=stage_repeatability(bsc),
            auxiliary_size_px=(auxiliary.width_px, auxiliary.height_px),
        )
        runs = origin(reference), origin(bsc)
    calibration.save(out / "calibration.h5")
    return Calibrated(calibration, runs, seen.views)


def second_acquisition(rig: Rig, config: RigConfig, text: str, out: Path) -> dict[str, Sequence[View]]:
    """The face at POS.0 once more, and every scanned pose between the positions, turned by a few degrees; their dots.

    All poses, so that the whole calibrated volume is held against dots that took no part.
    """
    target = config.target.grid()
    again = _recipe(config, kind="bsc", poses=("face",)).model_copy(update={"y_offsets_mm": (0.0,)})
    with following("Validation scan") as progress:
        record_scan(rig, again, target, out / "pos0.h5", title="face at POS.0 once more", config_text=text)
        recipe = _recipe(config, kind="bsc")
        record_validation(rig, recipe, target, out / "between.h5", config_text=text, progress=progress)
    scanned: list[PhaseName] = ["bsc-corner", "bsc-face"] if "corner" in config.scan.poses else ["bsc-face"]
    phases: dict[str, list[PhaseName]] = {"pos0": ["bsc-face"], "between": scanned}
    views = {}
    with following("Validation", "images") as progress:
        for name, wanted in phases.items():
            with RunFile(out / f"{name}.h5") as run:
                views[name] = observe(run, target, "bsc", phases=wanted, progress=progress).views
    return views


def origin(run: RunFile) -> RunOrigin:
    """A run file as a report names it."""
    return RunOrigin(run.path.name, run.uuid, run.checksum)


def standard_stereo(calibration: Calibration) -> ErrorFigure:
    """The error of the reference pair."""
    figures = calibration.figures
    return ErrorFigure(
        figures["standard_stereo_error_mean_mm"],
        figures["standard_stereo_error_std_mm"],
        int(figures["standard_stereo_points"]),
    )


def _recipe(config: RigConfig, **changes: Any) -> ScanRecipe:
    scan = config.scan
    common: dict[str, Any] = {
        "positions": scan.positions,
        "step_mm": scan.step_mm,
        "frames_per_position": scan.frames_per_position,
        "poses": scan.poses,
        "corner_rotation_deg": scan.corner_rotation_deg,
        "face_rotation_deg": scan.face_rotation_deg,
        "settle_s": scan.settle_s,
        "exposure_s": scan.exposure_s,
        "gain_db": scan.gain_db,
    }
    return ScanRecipe(**{**common, **changes})
