"""Hold a calibration against an acquisition that took no part in it, and ask whether the rig has moved."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bscd.acquisition import PhaseName, RunFile
from bscd.analysis.validation import Validation, validate
from bscd.calibration import Calibration, GridTarget
from bscd.calibration.observations import PoseName
from bscd.errors import InputError
from bscd.procedures.align import DEFAULT_FRAMES, picture
from bscd.procedures.calibrate import JACK_TOLERANCE_MM
from bscd.procedures.checks import find_two_grids, split_line
from bscd.procedures.observing import observe
from bscd.procedures.progress import ProgressCallback
from bscd.procedures.recipes import ScanRecipe
from bscd.procedures.rig import Rig
from bscd.procedures.scan import ScanResult, record_scan


def record_validation(
    rig: Rig,
    recipe: ScanRecipe,
    target: GridTarget,
    path: str | Path,
    *,
    rotation_offset_deg: float = 3.0,
    config_text: str = "",
    progress: ProgressCallback | None = None,
    stop: threading.Event | None = None,
) -> ScanResult:
    """Scan the target between the positions of a calibration's ``recipe``, turned by a few degrees.

    Raises as `bscd.procedures.record_scan`.
    """
    between = recipe.between(rotation_offset_deg)
    return record_scan(
        rig,
        between,
        target,
        path,
        title="validation scan between the calibrated positions",
        config_text=config_text,
        progress=progress,
        stop=stop,
    )


def validate_run(
    calibration: Calibration, run: RunFile, target: GridTarget, *, progress: ProgressCallback | None = None
) -> Validation:
    """Reconstruct the dots of a validation scan and compare them with where the axes put them.

    Raises `InputError` for the run that the calibration was made from: on its own images every error is small by
    construction.
    """
    if run.uuid == calibration.origins.get("bsc_uuid"):
        raise InputError(f"{run.path}: the calibration was made from this run; validate it with another acquisition")
    there = {str(phase) for phase in run.table("primary")["phase"]}
    bsc_phases: tuple[PhaseName, ...] = ("bsc-corner", "bsc-face")
    phases: list[PhaseName] = [phase for phase in bsc_phases if phase in there]
    seen = observe(run, target, "bsc", phases=phases or None, progress=progress)
    return validate(calibration, seen.views, target)


@dataclass(frozen=True)
class CalibrationCheck:
    """Whether a calibration still holds: the median epipolar residual (px) of a check frame against its limit."""

    moved: bool
    epipolar_px: float
    limit_px: float
    dots: int
    jack_difference_mm: float
    """The jacks' reading now minus the one in the biprism scan; NaN when that was not recorded."""
    advice: str
    """What to do, empty when the calibration holds."""


def check_calibration(
    rig: Rig, calibration: Calibration, target: GridTarget, *, pose: PoseName = "corner", frames: int = DEFAULT_FRAMES
) -> CalibrationCheck:
    """Look at the target through the raised biprism, where it stands, and say whether the rig has moved.

    Moves nothing. Raises `CheckFailedError` when the dots can not be found in both halves.
    """
    seen = picture(rig.primary, pose, "primary camera, check of the calibration", frames)
    halves = find_two_grids(seen, target, split_line(seen.image))
    left, right = halves["left"], halves["right"]
    both, at_left, at_right = np.intersect1d(left.index, right.index, return_indices=True)
    points = calibration.reconstruct(left.xy_px[at_left], right.xy_px[at_right])
    known = points.epipolar_px[np.isfinite(points.epipolar_px)]
    difference_mm = rig.jacks.status().position - calibration.jack_mm
    moved = calibration.moved(points)
    return CalibrationCheck(
        moved=moved,
        epipolar_px=float(np.median(known)) if known.size else float("nan"),
        limit_px=calibration.epipolar_limit_px,
        dots=len(both),
        jack_difference_mm=difference_mm,
        advice=_advice(moved, difference_mm, known.size),
    )


def _advice(moved: bool, jack_difference_mm: float, known: int) -> str:
    if abs(jack_difference_mm) > JACK_TOLERANCE_MM:
        return f"the jacks stand {jack_difference_mm:+.2f} mm off; move them back and check again, or calibrate again"
    if moved and not known:
        return "no dot lies in the calibrated volume; move the target to POS.0 and check again"
    return "camera or biprism has moved since the calibration; calibrate again" if moved else ""
