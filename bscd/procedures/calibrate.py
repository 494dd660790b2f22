"""Calibrate the biprism system from its two scans, as they lie in run files."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime

from bscd.acquisition import RunFile
from bscd.calibration import Calibration, CalibrationChoices, GridTarget, calibrate
from bscd.errors import InputError
from bscd.procedures.observing import Observations, observe
from bscd.procedures.progress import Progress, ProgressCallback
from bscd.version import __version__

JACK_TOLERANCE_MM = 0.1
"""How far the jacks' readings may differ within a biprism scan."""


def utc_now() -> datetime:
    """The host's wall clock, UTC."""
    return datetime.now(UTC)


def calibrate_runs(
    reference: RunFile,
    bsc: RunFile,
    target: GridTarget,
    choices: CalibrationChoices | None = None,
    *,
    progress: ProgressCallback | None = None,
    warn: Callable[[str], None] | None = None,
    now: Callable[[], datetime] = utc_now,
) -> Calibration:
    """Find the dots of both scans and calibrate; both may be in the same file.

    ``warn`` gets a sentence for each thing that is worth knowing and kept nothing from being done.

    Raises
    ------
    InputError
        A phase is missing, the jacks did not stand raised, or what `bscd.calibration.calibrate` refuses.
    CheckFailedError
        Images that can not be used.
    """
    seen_reference = observe(reference, target, "reference", progress=_part(progress, "reference scan"))
    seen_bsc = observe(bsc, target, "bsc", progress=_part(progress, "biprism scan"))
    if warn is not None:
        for text in dict.fromkeys((*seen_reference.warnings, *seen_bsc.warnings)):
            warn(text)
    return calibrate_observations(
        seen_reference,
        seen_bsc,
        target,
        choices,
        auxiliary_size_px=(reference.cameras["auxiliary"].width_px, reference.cameras["auxiliary"].height_px),
        origins=origins_of(reference, bsc, now()),
        repeatability=stage_repeatability(bsc),
    )


def calibrate_observations(
    reference: Observations,
    bsc: Observations,
    target: GridTarget,
    choices: CalibrationChoices | None = None,
    *,
    auxiliary_size_px: tuple[int, int] | None = None,
    origins: Mapping[str, str] | None = None,
    repeatability: tuple[float, float] = (0.0, 0.0),
) -> Calibration:
    """Calibrate from the dots of both scans; ``repeatability`` is the stages', one sigma, (mm, deg).

    ``auxiliary_size_px`` is (width, height) of the auxiliary camera's images (None: the same as the primary's).
    Raises `InputError` when the images differ in size, the biprism was not raised for the one scan alone, and for
    what `bscd.calibration.calibrate` refuses.
    """
    if reference.image_size_px != bsc.image_size_px:
        raise InputError(
            f"calibration: the biprism scan's images are {bsc.image_size_px} px, the reference scan's "
            f"{reference.image_size_px} px; use one setting of the primary camera for both"
        )
    return calibrate(
        reference.views,
        bsc.views,
        target,
        bsc.image_size_px,
        choices,
        auxiliary_size_px=auxiliary_size_px,
        origins=origins,
        jack_mm=_raised_mm(reference, bsc),
        stage_sigma_mm=repeatability[0],
        stage_sigma_deg=repeatability[1],
    )


def stage_repeatability(run: RunFile) -> tuple[float, float]:
    """One sigma of the translation (mm) and rotation stage (deg) as the run states it; 0 where it does not."""
    axes = run.header.axes
    values = [axes[name].tolerance if name in axes else math.nan for name in ("translation", "rotation")]
    first, second = (0.0 if math.isnan(value) else value for value in values)
    return first, second


def _raised_mm(reference: Observations, bsc: Observations) -> float:
    """The jacks' height in the biprism scan, mm; NaN when it was not recorded.

    Raises `InputError` when the biprism was moved during that scan, or stood no higher than in the reference scan.
    """
    heights = [height for height in bsc.jack_mm if not math.isnan(height)]
    if not heights:
        return math.nan
    low, high = min(heights), max(heights)
    if high - low > JACK_TOLERANCE_MM:
        raise InputError(
            f"calibration: the jacks moved from {low:g} to {high:g} mm during the biprism scan; scan again without "
            f"moving the biprism"
        )
    lowered = [height for height in reference.jack_mm if not math.isnan(height)]
    if lowered and max(lowered) >= low:
        raise InputError(
            f"calibration: the jacks stood at {low:g} mm in the biprism scan and at {max(lowered):g} mm in the "
            f"reference scan; raise the biprism for the one and lower it for the other"
        )
    return sum(heights) / len(heights)


def origins_of(reference: RunFile, bsc: RunFile, time: datetime) -> dict[str, str]:
    """What a calibration keeps of the runs that it was made from."""
    origins = {"program_version": __version__, "time": time.isoformat(timespec="seconds")}
    for role, run in (("reference", reference), ("bsc", bsc)):
        origins |= {
            f"{role}_file": run.path.name,
            f"{role}_uuid": run.uuid,
            f"{role}_checksum": run.checksum,
            f"{role}_time": run.header.start_time,
            f"{role}_configuration": run.config_text,
            f"{role}_recipe": run.recipe_text,
        }
    return origins


def _part(progress: ProgressCallback | None, name: str) -> ProgressCallback | None:
    if progress is None:
        return None

    def report(now: Progress) -> None:
        progress(replace(now, doing=f"{name}: {now.doing}"))

    return report
