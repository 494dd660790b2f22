"""Measure a run in one call; the results are a file's, so memory does not grow with the frames."""

from __future__ import annotations

import os
import shutil
import tempfile
import warnings
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from bscd.acquisition import RunFile
from bscd.calibration import Calibration
from bscd.offline.measured_run import MeasuredRun
from bscd.procedures import ProgressCallback
from bscd.procedures.measuring import MeasureSettings, measure_to_file


def measure(
    calibration: Calibration | str | os.PathLike[str],
    run: RunFile | str | os.PathLike[str],
    *,
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | None = None,
    **settings: Any,
) -> MeasuredRun:
    """Measure shape, displacement and strain in every sphere or inflation frame of a run.

    >>> measured = bscd.measure("calibration.h5", "run.h5", step_px=10)
    >>> measured.uvw_mm[-1, :, 2]  # w of the last frame
    >>> measured.table()

    Parameters
    ----------
    calibration, run
        A file's path each, or what was opened of it. A `RunFile` stays open.
    out
        The results file to make; it must not exist. Without it the results are in a temporary file, which goes with
        the `MeasuredRun`.
    progress
        Called with a `Progress` after each frame.
    settings
        Fields of `MeasureSettings`: ``step_px``, ``subset_px``, ``stereo``, ``region``, ``extrapolate`` and the others.

    Raises
    ------
    InputError
        Calibration, run and settings that do not fit each other, or ``out`` that exists. What can not be measured in
        a frame is NaN there with its reason as status.
    TypeError
        A setting that there is not.
    """
    chosen = MeasureSettings(**settings)
    with ExitStack() as opened:
        loaded = calibration if isinstance(calibration, Calibration) else Calibration.load(Path(calibration))
        source = run if isinstance(run, RunFile) else opened.enter_context(RunFile(run))
        name = "" if isinstance(calibration, Calibration) else Path(calibration).name
        folder = Path(tempfile.mkdtemp(prefix="bscd-")) if out is None else None
        path = Path(out) if out is not None else Path(str(folder), "results.h5")
        try:
            measure_to_file(loaded, source, path, chosen, calibration_name=name, progress=progress, warn=_warn)
            return MeasuredRun(path, temporary_folder=folder)
        except BaseException:
            if folder is not None:
                shutil.rmtree(folder, ignore_errors=True)
            raise


def open_results(path: str | os.PathLike[str]) -> MeasuredRun:
    """A results file of `measure` or of ``bscd measure``. Raises `InputError` when it is not one."""
    return MeasuredRun(path)


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=3)
