"""The kernels of `Curvature`: what lies off the local fits, and how much of that noise lets expect."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def residuals(values, known, good, index, weights, out):
    """Values ``(N, 2)`` less those of their fits, rows 0 of the weights ``(N, 6, K)``; NaN where there is none."""
    for n in range(len(values)):
        if not (known[n] and good[n]):
            out[n] = math.nan
            continue
        first, second = values[n, 0], values[n, 1]
        for k in range(index.shape[1]):
            other = index[n, k]
            if known[other]:
                first -= weights[n, 0, k] * values[other, 0]
                second -= weights[n, 0, k] * values[other, 1]
        out[n, 0], out[n, 1] = first, second


@njit(cache=True, nogil=True)
def second_orders(values, known, index, count, weights, out):
    """Second derivatives ``(N, 6)`` of values ``(N, 2)``: rows 3 to 5 of the weights ``(N, 6, K)``, of each component.

    The neighbours, ``index`` ``(N, K)``, are the first ``count`` ``(N,)`` of theirs.
    """
    for n in range(len(values)):
        for term in range(3):
            first, second = 0.0, 0.0
            for k in range(count[n]):
                other = index[n, k]
                if known[other]:
                    first += weights[n, 3 + term, k] * values[other, 0]
                    second += weights[n, 3 + term, k] * values[other, 1]
            out[n, term], out[n, 3 + term] = first, second


@njit(cache=True, nogil=True)
def leftover(offset, count, weights, rows, subset, out):
    """Variance ``(N,)`` of points about their fits for errors of unit variance that overlapping subsets share.

    Of the ``rows`` ``(n,)``, whose neighbours lie at the first ``count`` of the offsets ``(N, K, 2)``.
    """
    for n in rows:
        total = 1.0
        for k in range(count[n]):
            weight = weights[n, 0, k]
            if weight == 0.0:
                continue
            total += weight * (weight - 2.0 * _shared(offset[n, k, 0], offset[n, k, 1], subset))
            for j in range(k):
                across, down = offset[n, k, 0] - offset[n, j, 0], offset[n, k, 1] - offset[n, j, 1]
                total += 2.0 * weight * weights[n, 0, j] * _shared(across, down, subset)
        out[n] = total


@njit(cache=True, nogil=True)
def _shared(across, down, subset):
    """Share of two subsets that overlaps."""
    return max(1.0 - abs(across) / subset, 0.0) * max(1.0 - abs(down) / subset, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def half_squares(residual, covariance, used, out):
    """Half of ``r^T C^-1 r`` of residuals ``(N, 2)`` and covariances ``(N, 2, 2)``, 0 where not ``used``."""
    for n in range(len(residual)):
        out[n] = 0.0
        if used[n]:
            x, y, c = residual[n, 0], residual[n, 1], covariance[n]
            determinant = c[0, 0] * c[1, 1] - c[0, 1] * c[1, 0]
            out[n] = (x * (c[1, 1] * x - c[0, 1] * y) + y * (c[0, 0] * y - c[1, 0] * x)) / determinant / 2.0


@njit(cache=True, nogil=True)
def neighbour_sums(values, index, count, times):
    """Sums of values ``(N,)`` over each point's neighbours, the first ``count`` of ``index`` ``(N, K)``; repeated."""
    for _ in range(times):
        sums = np.zeros(len(values))
        for n in range(len(values)):
            for k in range(count[n]):
                sums[n] += values[index[n, k]]
        values = sums
    return values
