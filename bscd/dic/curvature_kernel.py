"""The kernels of `Curvature`: local fits, what lies off them, and how much of that noise lets expect."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TERMS = 6
"""Of a fit of second order: value, two first and three second derivatives."""

_RIDGE = 1e-9  # of the normal matrix's trace: what few neighbours leave open is taken as 0


@njit(cache=True, nogil=True)
def fit_weights(offset, index, count, known, rows, radius, half_square, weights, noise):
    """Weights ``(N, 6, K)`` of the neighbours in least-squares fits of second order about points ``rows`` ``(n,)``.

    The neighbours, ``index`` ``(N, K)``, are the first ``count`` ``(N,)`` at the offsets ``(N, K, 2)``; those that are
    not ``known`` ``(N,)`` have no weight. ``noise`` ``(N,)``: of ``half_square`` times the Laplacian for values of unit
    noise; infinite where there are too few.
    """
    normal, phi = np.empty((TERMS, TERMS)), np.empty(TERMS)
    for n in rows:
        normal[:] = 0.0
        weights[n] = 0.0
        there = 0
        for k in range(count[n]):
            if known[index[n, k]]:
                there += 1
                _basis(offset[n, k, 0] / radius, offset[n, k, 1] / radius, phi)
                for a in range(TERMS):
                    for b in range(TERMS):
                        normal[a, b] += phi[a] * phi[b]
        noise[n] = math.inf
        if there <= TERMS:
            continue
        ridge = _RIDGE * np.trace(normal) + 1e-12
        for a in range(TERMS):
            normal[a, a] += ridge
        inverse = np.linalg.inv(normal)
        squares = 0.0
        for k in range(count[n]):
            if known[index[n, k]]:
                _basis(offset[n, k, 0] / radius, offset[n, k, 1] / radius, phi)
                for a in range(TERMS):
                    weight = 0.0
                    for b in range(TERMS):
                        weight += inverse[a, b] * phi[b]
                    weights[n, a, k] = weight if a < 3 else weight / radius**2
                squares += weights[n, 3, k] ** 2 + weights[n, 5, k] ** 2
        noise[n] = half_square * math.sqrt(squares)


@njit(cache=True, inline="always")
def _basis(x, y, out):
    out[0], out[1], out[2], out[3], out[4], out[5] = 1.0, x, y, x * x / 2.0, x * y, y * y / 2.0


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
        uxx, uxy, uyy, vxx, vxy, vyy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(count[n]):
            other = index[n, k]
            if known[other]:
                u, v = values[other, 0], values[other, 1]
                xx, xy, yy = weights[n, 3, k], weights[n, 4, k], weights[n, 5, k]
                uxx, uxy, uyy = uxx + xx * u, uxy + xy * u, uyy + yy * u
                vxx, vxy, vyy = vxx + xx * v, vxy + xy * v, vyy + yy * v
        row = out[n]
        row[0], row[1], row[2], row[3], row[4], row[5] = uxx, uxy, uyy, vxx, vxy, vyy


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
