"""A measured run as arrays and as a table, each read from the results file when it is first asked for."""

from __future__ import annotations

import os
import shutil
import weakref
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, overload

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.offline.table import frame_columns
from bscd.results import FrameResult, PointCounts, ResultsFile, ResultsHeader, count_points

if TYPE_CHECKING:
    import pandas


class _Quantity:
    """One quantity over all frames: read when first asked for, then kept."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, run: None, owner: type) -> _Quantity: ...
    @overload
    def __get__(self, run: MeasuredRun, owner: type) -> FloatArray: ...
    def __get__(self, run: MeasuredRun | None, owner: type) -> _Quantity | FloatArray:
        if run is None:
            return self
        values = run.results.array(self._name)[: len(run)]
        run.__dict__[self._name] = values
        return values


class MeasuredRun:
    """T frames of N points; NaN where something is not known. A context manager; closing it lets the file go.

    ``xyz_mm``, ``displacement_mm`` ``(T, N, 3)`` are in the world frame, ``uvw_mm`` ``(T, N, 3)`` in the membrane
    frame; ``strain`` ``(T, N, 3)`` exx, eyy, exy and ``principal`` ``(T, N, 2)`` e1, e2 are Green-Lagrange strains;
    ``sigma_mm`` and ``displacement_sigma_mm`` ``(T, N, 3)`` one-sigma uncertainties; ``zncc``, ``epipolar_px``
    ``(T, N)``; ``left_px``, ``right_px`` ``(T, N, 2)`` where the point is in the views; ``time_s``, ``pressure_kpa``
    ``(T,)``. Each is read when first asked for and then kept: for runs that do not fit into memory take `frames`.

    Raises `InputError` when the file is no results file.
    """

    xyz_mm = _Quantity()
    displacement_mm = _Quantity()
    uvw_mm = _Quantity()
    strain = _Quantity()
    principal = _Quantity()
    sigma_mm = _Quantity()
    displacement_sigma_mm = _Quantity()
    zncc = _Quantity()
    epipolar_px = _Quantity()
    left_px = _Quantity()
    right_px = _Quantity()
    time_s = _Quantity()
    pressure_kpa = _Quantity()

    def __init__(self, path: str | os.PathLike[str], *, temporary_folder: Path | None = None) -> None:
        """Open a results file; a ``temporary_folder`` is removed at the end."""
        self.results = ResultsFile(path)
        self.frame_numbers: IntArray = self.results.frame_numbers()
        self._end = weakref.finalize(self, _let_go, self.results, temporary_folder)

    @property
    def path(self) -> Path:
        """The results file."""
        return self.results.path

    @property
    def header(self) -> ResultsHeader:
        """Where the numbers come from: run, calibration, parameters, membrane frame."""
        return self.results.header

    @property
    def points_px(self) -> FloatArray:
        """The requested points ``(N, 2)`` in the reference frame's left view."""
        return self.results.points_px

    @property
    def status_names(self) -> Mapping[int, str]:
        """What each status code means."""
        return self.header.status_names

    @cached_property
    def status(self) -> NDArray[np.uint8]:
        """0 where a point was measured, else the reason's code, ``(T, N)``."""
        return self.results.array("status")[: len(self)]

    @property
    def valid(self) -> BoolArray:
        """Which points were measured, ``(T, N)``."""
        return self.status == 0

    @property
    def extrapolated(self) -> BoolArray:
        """Which points have a position although they are not valid: outside the calibrated hull, ``(T, N)``."""
        return ~self.valid & np.isfinite(self.xyz_mm).all(axis=2)

    @cached_property
    def counts(self) -> PointCounts:
        """How many points of all frames are valid, extrapolated, or lost and why."""
        return count_points(self.frames())

    def __len__(self) -> int:
        """How many frames there are, T."""
        return len(self.frame_numbers)

    def frame(self, index: int) -> FrameResult:
        """One frame by its place, from 0; negative ones count from the end. `IndexError` where there is none."""
        return self.results.frame(index if index >= 0 else len(self) + index)

    def frames(self) -> Iterator[FrameResult]:
        """The frames in the order recorded, each read when its turn comes."""
        return (self.results.frame(index) for index in range(len(self)))

    def table(self, frame: int | None = None) -> pandas.DataFrame:
        """A row for each point of one frame (by its place, as in `frame`) or of all of them.

        Columns are those of the CSV export with the frame's number, time and pressure and the point's place before
        them, the displacement's sigma, ``extrapolated`` and the status' name after them.
        """
        import pandas as pd  # a quarter of a second that those who need no table need not wait

        frames = self.frames() if frame is None else [self.frame(frame)]
        parts = [pd.DataFrame(frame_columns(self.points_px, one)) for one in frames]
        whole = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()
        if parts:
            names = [self.status_names.get(code, str(code)) for code in range(256)]
            whole["status"] = pd.Categorical.from_codes(whole["status"], names).remove_unused_categories()
        return whole

    def close(self) -> None:
        """Close the results file, and remove it if it is a temporary one; may be called twice."""
        self._end()

    def __enter__(self) -> MeasuredRun:
        """The run itself."""
        return self

    def __exit__(self, *ended: object) -> None:
        """Close it."""
        self.close()

    def __repr__(self) -> str:
        """What it is, in a line."""
        return f"<MeasuredRun {self.header.title!r}: {len(self)} frames of {len(self.points_px)} points>"


def _let_go(results: ResultsFile, temporary_folder: Path | None) -> None:
    results.close()
    if temporary_folder is not None:
        shutil.rmtree(temporary_folder, ignore_errors=True)
