"""Calibrate from run files; the target's geometry comes from their configuration."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bscd.acquisition import RunFile
from bscd.calibration import Calibration, CalibrationChoices
from bscd.config import parse_target
from bscd.errors import InputError
from bscd.procedures import ProgressCallback, calibrate_runs


def calibrate(
    reference: str | os.PathLike[str],
    bsc: str | os.PathLike[str],
    *,
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | None = None,
    **choices: Any,
) -> Calibration:
    """Calibrate the biprism system from the run files of its two scans, or the one that holds both.

    >>> calibration = bscd.calibrate("reference.h5", "bsc.h5", out="calibration.h5")

    Parameters
    ----------
    reference, bsc
        The scan with the biprism lowered, and the one with it raised.
    out
        A calibration file to make as well; it must not exist.
    progress
        Called with a `Progress` after each image.
    choices
        Fields of `CalibrationChoices`: ``reference``, ``solver``, ``interpolant``, ``triangulation``, ``degree``.

    Raises
    ------
    InputError
        Files that are no such scans, that do not fit each other, or ``out`` that exists.
    CheckFailedError
        Images that can not be used.
    TypeError
        A choice that there is not.
    """
    if out is not None and Path(out).exists():
        raise InputError(f"{out}: exists already; calibrations are never overwritten, choose another name")
    made = calibrate_files(reference, bsc, CalibrationChoices(**choices), progress=progress, warn=_warn)
    if out is not None:
        made.save(Path(out))
    return made


def calibrate_files(
    reference: str | os.PathLike[str],
    bsc: str | os.PathLike[str],
    choices: CalibrationChoices,
    *,
    progress: ProgressCallback | None = None,
    warn: Callable[[str], None] | None = None,
) -> Calibration:
    """Calibrate from two run files (or one that holds both scans); raises as `calibrate` does."""
    with RunFile(reference) as reference_run, RunFile(bsc) as bsc_run:
        texts = [parse_target(run.config_text, f"{run.path}, configuration").target for run in (reference_run, bsc_run)]
        say = warn or (lambda _: None)
        for name in sorted({"columns", "rows", "pitch_mm", "dot_diameter_mm", "margin_mm"} - texts[0].model_fields_set):
            say(f"{reference}: its configuration does not give [target] {name}; {getattr(texts[0], name):g} is taken")
        if texts[0] != texts[1]:
            raise InputError(f"{reference} and {bsc} name different targets; scan the same target twice")
        return calibrate_runs(reference_run, bsc_run, texts[0].grid(), choices, progress=progress, warn=warn)


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=3)
