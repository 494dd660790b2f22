"""Find points again after a jump, at a cost that is bounded where there is nothing to find.

A few points are tried first; only what they find is tried at all the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from functools import cached_property

import numpy as np

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.dic.correlation import Correlation
from bscd.dic.guess import DenseFlow, FeatureMatches, guess_by_search, seed_points
from bscd.dic.images import PreparedImage

#: One point in a cell of so many subsets is tried first.
_TRIAL_SUBSETS = 2.5

#: Window of the last resort's search, px (paper, section 2.2.3).
_SEARCH_PX = 41

#: A jump is coarse, and what is found by the strongest features spreads to the neighbours.
_FEATURES = 1500

#: Enough are found when no more than this share is lost.
_ENOUGH_LOST = 0.1

#: Points are looked for at least as often, in frames, however long they have been lost.
_SELDOM = 16

Attempt = Callable[[IntArray, FloatArray], Correlation]
"""Correlate some of the points, ``(n,)`` their indices, from shape parameters ``(n, P)``, NaN where not known."""


class Jump:
    """How the surface moved from one image to another; each finder is asked once, whoever wants to know."""

    def __init__(self, previous: PreparedImage, current: PreparedImage) -> None:
        self._images = (previous, current)

    @cached_property
    def flow(self) -> DenseFlow:
        """By dense flow."""
        return DenseFlow(*self._images)

    @cached_property
    def features(self) -> FeatureMatches:
        """By matched features."""
        return FeatureMatches(*self._images, most=_FEATURES)


def recovered(
    first: Correlation,
    start_px: FloatArray,
    last: FloatArray,
    jump: Jump,
    images: tuple[PreparedImage, PreparedImage],
    subset_px: int,
    attempt: Attempt,
) -> Correlation:
    """What was matched, ``first``, and what else the jump lets find: by flow, then features, then a search.

    ``start_px`` ``(N, 2)`` are the points in the reference, ``last`` ``(N, P)`` the shape parameters with which they
    were last seen, in the image that the jump starts from.
    """
    found = first
    half = last.shape[1] // 2
    for finder in (lambda: jump.flow, lambda: jump.features, None):
        lost = np.flatnonzero(~found.valid & np.isfinite(last).all(axis=1))
        if np.count_nonzero(~found.valid) <= _ENOUGH_LOST * len(start_px) or not len(lost):
            break
        trial = lost[trial_points(start_px[lost], subset_px)]
        guess = np.full((len(start_px), 6), np.nan)
        if finder is None:
            about = last[:, [0, half]]
            guess[trial] = guess_by_search(*images, start_px[trial], about[trial], subset_px, _SEARCH_PX)
            found = merged(found, lost, attempt(lost, guess[lost]))
            break
        step = np.full((len(start_px), 6), np.nan)
        step[trial] = finder().at((start_px + last[:, [0, half]])[trial])
        guess[trial] = after(last[trial], step[trial])
        found = merged(found, lost, attempt(lost, guess[lost]))
        left = lost[~found.valid[lost]]
        if len(left) < len(lost) and len(left):
            step = finder().at((start_px + last[:, [0, half]])[left])
            found = merged(found, left, attempt(left, after(last[left], step)))
    if np.count_nonzero(found.valid) > np.count_nonzero(first.valid):
        # once more all together, so that neighbours judge what was found apart
        everything = np.arange(len(start_px))
        found = merged(found, everything, attempt(everything, found.shape), always=True)
    return found


def is_due(lost_for: IntArray) -> BoolArray:
    """Whether points ``(N,)``, lost for so many frames, are tried without neighbours: less and less often."""
    return ((lost_for & (lost_for - 1)) == 0) | (lost_for % _SELDOM == 0)


def trial_points(points_px: FloatArray, subset_px: int) -> IntArray:
    """Indices of a few of the points ``(N, 2)`` that tell whether anything is there."""
    return seed_points(points_px, _TRIAL_SUBSETS * subset_px)


def merged(whole: Correlation, index: IntArray, part: Correlation, always: bool = False) -> Correlation:
    """The whole with those of a part's points, ``index`` ``(n,)``, that are valid there; ``always``: all of them."""
    taken = np.ones(len(index), bool) if always else part.valid
    values = {}
    for name in (each.name for each in fields(whole)):
        value = getattr(whole, name)
        if isinstance(value, np.ndarray):
            values[name] = value.copy()
            values[name][index[taken]] = getattr(part, name)[taken]
    return replace(whole, **values)


def after(shape: FloatArray, step: FloatArray) -> FloatArray:
    """Affine parts of a shape ``(n, 6 or 12)`` followed by an affine step ``(n, 6)``, as ``(n, 6)``."""
    half = shape.shape[1] // 2
    gradient = np.stack([shape[:, [1, 2]], shape[:, [half + 1, half + 2]]], axis=1)
    more = np.stack([step[:, [1, 2]], step[:, [4, 5]]], axis=1)
    total = (np.eye(2) + more) @ (np.eye(2) + gradient) - np.eye(2)
    moved = shape[:, [0, half]] + step[:, [0, 3]]
    return np.column_stack([moved[:, 0], total[:, 0], moved[:, 1], total[:, 1]])
