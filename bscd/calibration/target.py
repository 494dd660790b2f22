"""Calibration targets: the cube with a plain dot grid on two adjacent faces, and bodies with surveyed marks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray, IntArray

FACES = ("right", "left")


@dataclass(frozen=True)
class GridTarget:
    """A cube with the same square dot grid on two adjacent faces.

    The label of a dot is ``index = (face * rows + row) * columns + column``: face 0 is the one that runs to the
    right in the corner pose (the one that is scanned), face 1 the left one; row 0 is the top, column 0 is next
    to the edge. ``margin_mm`` is the distance from the cube's edge to the first dot column.
    """

    columns: int = 9
    rows: int = 23
    pitch_mm: float = 2.0
    dot_diameter_mm: float = 1.0
    margin_mm: float = 2.0

    @property
    def dots_per_face(self) -> int:
        """Dots on one face."""
        return self.columns * self.rows

    def index(self, face: int, row: IntArray | int, column: IntArray | int) -> IntArray:
        """Labels of dots given by face (0 right, 1 left), row (0 top) and column (0 next to the edge)."""
        return np.asarray((face * self.rows + np.asarray(row)) * self.columns + np.asarray(column), np.int64)

    def face_row_column(self, index: IntArray) -> tuple[IntArray, IntArray, IntArray]:
        """Face, row and column of labels."""
        rest, column = np.divmod(np.asarray(index, np.int64), self.columns)
        face, row = np.divmod(rest, self.rows)
        return face, row, column

    def points_mm(self, index: IntArray | None = None) -> FloatArray:
        """World positions ``(N, 3)`` mm in the corner pose at POS.0 (all dots of both faces by default).

        They define the world frame (DESIGN section 2): origin on the edge at the middle of the dot rows, z up,
        faces along (+-1/sqrt 2, 1/sqrt 2, 0).
        """
        if index is None:
            index = np.arange(2 * self.dots_per_face)
        face, row, column = self.face_row_column(index)
        along = (self.margin_mm + column * self.pitch_mm) / math.sqrt(2.0)
        z = ((self.rows - 1) / 2.0 - row) * self.pitch_mm
        return np.stack([np.where(face == 0, along, -along), along, z], axis=-1).astype(np.float64)


@dataclass(frozen=True)
class PointsTarget:
    """A body with surveyed marks: ``labels`` and their positions ``xyz_mm`` ``(N, 3)``.

    The label of a mark in a `View` is its place in ``labels``.
    """

    labels: tuple[str, ...]
    xyz_mm: FloatArray
    mark_size_mm: float

    def points_mm(self, index: IntArray | None = None) -> FloatArray:
        """Positions ``(N, 3)`` mm of the marks with these places in ``labels`` (all by default)."""
        return self.xyz_mm if index is None else self.xyz_mm[np.asarray(index, np.int64)]
