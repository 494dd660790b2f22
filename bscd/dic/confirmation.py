"""Which matches their neighbours confirm: a likeness by chance stands alone, a true match is part of a field."""

from __future__ import annotations

import numpy as np

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.dic.trees import quick_tree

#: Neighbours that are asked, of whom this share must agree; with fewer than these nothing can be told.
_NEIGHBOURS = 8
_SHARE = 3 / 8
_FEWEST = 3

#: Neighbours farther away than this have no say, in subsets.
_REACH_SUBSETS = 4.0

#: How far neighbours in a steep field may be from what both their gradients let expect: px, and px a px of distance.
_AGREE_PX = 2.0
_AGREE_PER_PX = 0.1


def confirmed(
    index: IntArray,
    points_px: FloatArray,
    shape: FloatArray,
    valid: BoolArray,
    sure: BoolArray,
    zncc: FloatArray,
    subset_px: int,
) -> BoolArray:
    """Whether neighbours agree with the matches of some points, ``index`` ``(n,)``.

    All points ``(N, 2)`` that were asked for, with their shape parameters ``(N, P)``, whether they have a match,
    ``valid`` ``(N,)``, and one beyond doubt, ``sure`` ``(N,)``; ``zncc`` ``(N,)`` picks one of many. A neighbour
    without a match does not agree. Subsets that overlap err together, so neighbours that are not sure are asked only
    when they are a subset or more away. Without enough neighbours, and none that is sure, a match counts as confirmed;
    one that is sure itself is not refused by so few at all.
    """
    voters = _best_in_cells(points_px, np.where(valid, zncc, -2.0), subset_px)
    distance, near = quick_tree(points_px[voters]).query(
        points_px[index], k=2 * _NEIGHBOURS, distance_upper_bound=_REACH_SUBSETS * subset_px
    )
    there = np.isfinite(distance)
    other = voters[np.where(there, near, 0)]
    asked = there & (sure[other] | (distance >= subset_px))
    asked &= np.cumsum(asked, axis=1) <= _NEIGHBOURS
    off = _disagreement_px(shape[index][:, None], shape[other], points_px[other] - points_px[index][:, None])
    agrees = asked & valid[other] & (off < _AGREE_PX + _AGREE_PER_PX * np.where(there, distance, 0.0))
    count = np.count_nonzero(asked, axis=1)
    too_few = (count < _FEWEST) & (sure[index] | ~(asked & sure[other]).any(axis=1))
    return (np.count_nonzero(agrees, axis=1) >= _SHARE * count) | too_few


def _best_in_cells(points_px: FloatArray, score: FloatArray, cell_px: float) -> IntArray:
    """Indices of the point of highest score in each cell of a square grid."""
    column, row = (np.floor(points_px / cell_px) - np.floor(points_px.min(axis=0) / cell_px)).astype(np.int64).T
    cell = row * (column.max() + 1) + column
    highest = np.full(cell.max() + 1, -np.inf)
    np.maximum.at(highest, cell, score)
    best = np.flatnonzero(score == highest[cell])[::-1]
    chosen = np.full(len(highest), -1)
    chosen[cell[best]] = best  # of those that are the same the first, which is written last
    return chosen[chosen >= 0]


def _disagreement_px(one: FloatArray, other: FloatArray, offset_px: FloatArray) -> FloatArray:
    """How far displacements are from differing as the mean of their gradients says, for shapes ``(..., P)``."""
    half = one.shape[-1] // 2
    change, mean = other - one, (one + other) / 2.0
    off = [
        change[..., side] - mean[..., side + 1] * offset_px[..., 0] - mean[..., side + 2] * offset_px[..., 1]
        for side in (0, half)
    ]
    return np.hypot(*off)
