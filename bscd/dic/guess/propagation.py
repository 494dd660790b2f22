"""Initial guesses from matched neighbours: reliability-guided propagation (Pan 2009, Appl Opt 48:1535-1542)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from bscd.arrays import FloatArray, IntArray


def seed_points(points_px: FloatArray, cell_px: float) -> IntArray:
    """Indices of one point in each cell of a square grid: the one nearest to the cell's middle, lowest index first."""
    if not len(points_px):
        return np.zeros(0, np.int64)
    cells = np.floor(points_px / cell_px)
    off = np.abs(points_px / cell_px - cells - 0.5).max(axis=1)
    column, row = (cells - cells.min(axis=0)).astype(np.int64).T
    cell = row * (column.max() + 1) + column
    order = np.lexsort((off, cell))
    return np.sort(order[np.flatnonzero(np.diff(cell[order], prepend=-1))])


def nearest_known(
    points_px: FloatArray, known_px: KDTree, reliability: FloatArray, candidates: int = 1
) -> tuple[IntArray, FloatArray]:
    """For each point ``(N, 2)`` the most reliable of its nearest known points, M > 0 in a tree, and how far it is.

    ``reliability`` ``(M,)``: higher is better (ZNCC). Returns indices ``(N,)`` and distances ``(N,)`` px.
    """
    distance, index = known_px.query(points_px, k=min(candidates, known_px.n))
    if index.ndim == 1:
        return index, distance
    best = np.argmax(reliability[index], axis=1)[:, None]
    return np.take_along_axis(index, best, axis=1)[:, 0], np.take_along_axis(distance, best, axis=1)[:, 0]


def extrapolate(shape: FloatArray, offset_px: FloatArray) -> FloatArray:
    """Shape parameters ``(N, 6 or 12)`` of points at an offset ``(N, 2)`` from those whose they are."""
    moved = shape.copy()
    dx, dy = offset_px[:, 0], offset_px[:, 1]
    half = shape.shape[1] // 2
    for first in (0, half):
        a = shape[:, first : first + half].T
        if half == 3:
            moved[:, first] = a[0] + a[1] * dx + a[2] * dy
        else:
            moved[:, first] = a[0] + a[1] * dx + a[2] * dy + a[3] * dx * dx / 2 + a[4] * dx * dy + a[5] * dy * dy / 2
            moved[:, first + 1] = a[1] + a[3] * dx + a[4] * dy
            moved[:, first + 2] = a[2] + a[4] * dx + a[5] * dy
    return moved
