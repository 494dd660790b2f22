"""What dot finding takes and gives: seeds, the split line, labelled dots, what is missing and why, marks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import FloatArray, IntArray

#: A monochrome image ``(H, W)``: uint8, uint16 or float.
Image = NDArray[np.integer | np.floating]


@dataclass(frozen=True)
class SplitLine:
    """The nearly vertical line where the two halves of a biprism image meet.

    ``column_px`` is its column at the middle row ``middle_row_px``, ``tilt`` its slope (px of column per px of
    row), ``found`` whether the discontinuity itself was seen (else the line is the middle of the dark gap between
    the halves), ``sigma_px`` the standard uncertainty of ``column_px``.
    """

    column_px: float
    tilt: float
    found: bool
    sigma_px: float
    middle_row_px: float

    def column_at(self, row_px: FloatArray | float) -> FloatArray:
        """Columns (px) of the line at these rows (px)."""
        return np.asarray(self.column_px + self.tilt * (np.asarray(row_px, np.float64) - self.middle_row_px))


@dataclass(frozen=True)
class SplitRegion:
    """One half of a biprism image: the columns "left" (below) or "right" (above) of a split line."""

    split: SplitLine
    half: Literal["left", "right"]


@dataclass(frozen=True)
class Seed:
    """A dot that the operator points out: its face (0 right, 1 left), row, column and position (column, row) px."""

    face: int
    row: int
    column: int
    xy_px: tuple[float, float]


@dataclass(frozen=True)
class MissingDot:
    """A dot of the target that was not measured: its label, why, and where it should be (px), if that is known."""

    index: int
    reason: str
    xy_px: tuple[float, float] | None


@dataclass(frozen=True)
class GridFinding:
    """The labelled dots of one view.

    ``index`` ``(N,)`` are labels of `GridTarget`, ascending; ``xy_px`` ``(N, 2)`` the images of the dots' centres
    (column, row), corrected for the projected circle's centre; ``sigma_px`` ``(N,)`` their standard uncertainty
    per axis. ``missing`` names the dots of the faces seen that were not measured; ``saturated_fraction`` is the
    share of the pixels on and around the dots at full scale.
    """

    index: IntArray
    xy_px: FloatArray
    sigma_px: FloatArray
    missing: tuple[MissingDot, ...]
    saturated_fraction: float
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Marks:
    """Dark marks of any compact shape: grey-weighted centroids.

    ``xy_px`` ``(N, 2)`` (column, row), ``sigma_px`` ``(N,)``, ``area_px`` ``(N,)``, ``contrast`` ``(N,)`` the
    depth below the surroundings in grey levels.
    """

    xy_px: FloatArray
    sigma_px: FloatArray
    area_px: FloatArray
    contrast: FloatArray

    def __len__(self) -> int:
        """How many."""
        return len(self.xy_px)


@dataclass(frozen=True)
class MarkSeed:
    """A mark that the operator points out: its label in the target's table and its position (column, row) px."""

    label: str
    xy_px: tuple[float, float]


@dataclass(frozen=True)
class MarkFinding:
    """The labelled marks of one view.

    ``index`` ``(N,)`` are places in the target's table, ascending; ``xy_px`` ``(N, 2)``, ``sigma_px`` ``(N,)``;
    ``missing`` the marks that were not matched; ``rms_px`` the residual of the DLT through all of them, lens
    distortion included.
    """

    index: IntArray
    xy_px: FloatArray
    sigma_px: FloatArray
    missing: tuple[MissingDot, ...]
    rms_px: float
