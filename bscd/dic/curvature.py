"""What a field of displacements says of its points: its second derivatives, and how much the points scatter about it.

An affine match that holds the second derivatives follows steep strains unbiased.

What an affine subset misses of the field's second derivatives shifts its match by about (u_xx + u_yy) / 2 times the
mean square of its pixels' distance in each axis. Solving for them as well ("quadratic") doubles the noise; a field of
matches knows them far better than a single subset does.

Noise is not all that moves matches: blur and pixels that do not stretch with the surface, its shading, interpolation.
These differ from subset to subset, so they show as scatter about a smooth fit beyond what noise lets expect.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.dic.correlation import Correlation
from bscd.dic.correlator import correlate
from bscd.dic.curvature_kernel import (
    TERMS,
    fit_weights,
    half_squares,
    leftover,
    neighbour_sums,
    residuals,
    second_orders,
)
from bscd.dic.guess import seed_points
from bscd.dic.images import PreparedImage
from bscd.dic.solver import KnownSubsets
from bscd.dic.trees import quick_tree

#: The neighbourhood's radius, in subsets, and in distances between points where they are far apart.
_RADIUS_SUBSETS = 1.5
_RADIUS_SPACINGS = 3.0

#: No more than one neighbour in a cell of this share of the radius: closer ones share their noise.
_CELL = 0.3

#: A fit may add this share of the match's own noise; a worse one takes what its nearest neighbour has.
_LARGEST_NOISE = 0.5

#: Change of the held part whose effect, in sigma of the match, is not worth another solution.
_LARGEST_BIAS = 0.25

#: A match less alike than the median by more than this has no say on its neighbours.
_LESS_ALIKE = 0.1

#: Second derivatives are believed when 1 - ZNCC does not grow by more than this with them.
_NOT_WORSE = 1.01

#: A point that is off by more than this many times the variance that points have everywhere counts as this many; what
#: that takes off noise's mean is made up for.
_MOST_SCATTER = 2.0

#: Of a thousand points with nothing but noise one strays by this many times the variance.
_STRAY = 7.0

#: Median of half the sum of two unit normal variables' squares.
_MEDIAN = np.log(2.0)

#: Where uxx, uxy, uyy, vxx, vxy, vyy are among a second-order shape's parameters.
SECOND = np.array([3, 4, 5, 9, 10, 11])


class Curvature:
    """Local second-order fits about N points ``(N, 2)``; their weights are kept while the same points are known."""

    def __init__(self, points_px: FloatArray, subset_px: int, widened: float = 1.0) -> None:
        self._points_px = np.asarray(points_px, np.float64)
        self._subset_px = float(subset_px)
        self._square_px2 = (subset_px**2 - 1) / 12.0
        count = len(self._points_px)
        radius = _RADIUS_SUBSETS * subset_px
        if count > 1:
            spacing = float(np.median(quick_tree(self._points_px).query(self._points_px, k=2)[0][:, 1]))
            radius = max(radius, _RADIUS_SPACINGS * spacing * 1.01)
        radius *= widened
        self._offset, self._index = _neighbours(self._points_px, radius)
        self._count = np.count_nonzero(np.isfinite(self._offset[:, :, 0]), axis=1)  # the nearest ones come first
        self._radius_px = radius
        self._weights = np.zeros((count, TERMS, self._index.shape[1]))
        self._noise = np.full(count, np.inf)
        self._expected, self._stale = np.zeros(count), np.ones(count, bool)
        self._known = np.zeros(count, bool)
        self._fresh = True

    def second_derivatives(self, displacement_px: FloatArray) -> FloatArray:
        """uxx, uxy, uyy, vxx, vxy, vyy ``(N, 6)`` per px of displacements ``(N, 2)``, NaN where not known.

        Where no fit is possible they are those of the nearest point that has one; 0 where no point has.
        """
        known = np.asarray(np.isfinite(displacement_px).all(axis=1))
        self._fit(known)
        result = np.zeros((len(known), 6))
        fitted = self._good
        if not fitted.any():
            return result
        second_orders(np.asarray(displacement_px, np.float64), known, self._index, self._count, self._weights, result)
        bad = np.flatnonzero(~fitted)
        if len(bad):
            good = np.flatnonzero(fitted)
            result[bad] = result[good[quick_tree(self._points_px[good]).query(self._points_px[bad])[1]]]
        return result

    def residual_px(self, displacement_px: FloatArray) -> FloatArray:
        """What displacements ``(N, 2)``, NaN where not known, are off the field; NaN where no fit is possible."""
        known = np.asarray(np.isfinite(displacement_px).all(axis=1))
        self._fit(known)
        off = np.empty((len(known), 2))
        residuals(np.asarray(displacement_px, np.float64), known, self._good, self._index, self._weights, off)
        return off

    def scatter(self, residual_px: FloatArray, covariance_px2: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Variance ``(N,)`` of residuals ``(N, 2)`` over what their covariance ``(N, 2, 2)`` lets expect.

        Beside it which points stray by more than chance may explain, ``(N,)``. Local means; at least 1, and 1 where too
        little is known: Birge's ratio, squared (Birge 1932, Phys Rev 40:207-227). Points whose subsets overlap share
        their errors as far as they overlap. The residuals are those of the fit that was made last.
        """
        used = np.isfinite(residual_px).all(axis=1) & self._good
        if not used.any():
            return np.ones(len(used)), np.zeros(len(used), bool)
        stale = np.flatnonzero(self._stale)
        leftover(self._offset, self._count, self._weights, stale, self._subset_px, self._expected)
        self._stale[:] = False
        squares, expected = np.empty(len(used)), np.where(used, self._expected, 0.0)
        half_squares(residual_px, covariance_px2, used, squares)
        everywhere = max(float(np.median(squares[used] / expected[used])) / _MEDIAN, 1.0)
        stray = squares > _STRAY * everywhere * expected
        squares = np.minimum(squares, _MOST_SCATTER * everywhere * expected) / -np.expm1(-_MOST_SCATTER)
        squares, expected = (neighbour_sums(each, self._index, self._count, 2) for each in (squares, expected))
        ratio = np.divide(squares, expected, out=np.ones_like(squares), where=expected > 0.0)
        return np.maximum(ratio, 1.0), np.asarray(stray)

    def bias_px(self, second: FloatArray) -> FloatArray:
        """Bound ``(N, 2)`` of what second derivatives ``(N, 6)`` that were not held do to a match."""
        return np.abs(second.reshape(-1, 2, 3)).sum(axis=2) / 2.0 * self._square_px2

    @property
    def _good(self) -> BoolArray:
        """Where a fit is worth having, ``(N,)``."""
        return self._noise < _LARGEST_NOISE

    def _fit(self, known: BoolArray) -> None:
        """Bring the weights up to the known points; only where the neighbourhood changed."""
        changed = known != self._known
        rows = np.flatnonzero(changed[self._index].any(axis=1)) if not self._fresh else np.arange(len(known))
        self._known, self._fresh = known.copy(), False
        if not len(rows):
            return
        fit_weights(
            self._offset,
            self._index,
            self._count,
            known,
            rows,
            self._radius_px,
            self._square_px2 / 2.0,
            self._weights,
            self._noise,
        )
        self._stale[rows] = True


def _neighbours(points_px: FloatArray, radius_px: float) -> tuple[FloatArray, IntArray]:
    """Offsets ``(N, K, 2)`` and indices ``(N, K)`` of the points around each, NaN and 0 where there are fewer."""
    if not len(points_px):
        return np.zeros((0, 0, 2)), np.zeros((0, 0), np.int64)
    voters = seed_points(points_px, _CELL * radius_px)
    most = min(len(voters), int(np.ceil(np.pi * (1.0 / _CELL + 1.0) ** 2)))
    found = quick_tree(points_px[voters]).query(points_px, k=most, distance_upper_bound=radius_px)
    distance, near = (np.asarray(each).reshape(len(points_px), most) for each in found)
    there = np.isfinite(distance)
    most = max(int(there.sum(axis=1).max()), 1)
    there, index = there[:, :most], voters[np.where(there, near, 0)][:, :most]
    return np.where(there[:, :, None], points_px[index] - points_px[:, None], np.nan), index


def follow_curvature(
    reference: PreparedImage,
    current: PreparedImage,
    points_px: FloatArray,
    first: Correlation,
    curvature: Curvature,
    known_subsets: KnownSubsets | None = None,
    **settings: Any,
) -> tuple[Correlation, FloatArray]:
    """Match points ``(N, 2)`` once more where the second derivatives of the field differ from those that were held.

    ``first`` and ``settings`` are of `correlate` with the shape "curved". Returns the match and the second derivatives
    ``(N, 6)`` to go on with: the field's, but where they make a match less alike, those that were held.
    """
    if not first.valid.any():
        return first, first.shape[:, SECOND]
    # what is much less alike than the rest is half covered, and drawn aside
    known = first.valid & (first.zncc >= np.median(first.zncc[first.valid]) - _LESS_ALIKE)
    second = curvature.second_derivatives(np.where(known[:, None], first.displacement_px, np.nan))
    with np.errstate(invalid="ignore"):
        far = curvature.bias_px(second - first.shape[:, SECOND]) > _LARGEST_BIAS * first.sigma_px
    again = np.flatnonzero(first.valid & far.any(axis=1))
    if not len(again):
        return first, second
    guess = first.shape[again].copy()
    guess[:, SECOND] = second[again]
    found = correlate(
        reference,
        current,
        points_px[again],
        guess_px=guess,
        find_guesses=False,
        shape="curved",
        known_subsets=None if known_subsets is None else known_subsets.only(again),
        **settings,
    )
    better = found.valid & (1.0 - found.zncc <= _NOT_WORSE * (1.0 - first.zncc[again]))
    worse = again[~better]
    second[worse] = first.shape[np.ix_(worse, SECOND)]
    return first.updated(again[better], found.only(better)), second


def with_scatter(found: Correlation, curvature: Curvature, smooth: BoolArray) -> Correlation:
    """With the covariance that the field's own scatter asks for, taken where it is ``smooth`` ``(N,)``."""
    residual = np.where(smooth[:, None], curvature.residual_px(found.displacement_px), np.nan)
    scatter, _ = curvature.scatter(residual, found.covariance_px2)
    return replace(
        found,
        sigma_px=found.sigma_px * np.sqrt(scatter)[:, None],
        covariance_px2=found.covariance_px2 * scatter[:, None, None],
    )
