"""The kernels of the strain: local polynomial fits, their derivatives, and how noise passes through them."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

#: Columns of the table of weights: d/dcolumn and d/drow of the fit along the surface, then of the fit in depth.
WEIGHTS = 4
_SINGULAR = 1e-9  # pivot of the scaled normal matrix
_SAME = 1e-9  # of the window's half width: points that lie alike


@njit(cache=True, nogil=True)
def fit_rows(points, indptr, indices, valid, rows, half, order, depth_order, normals, fresh):
    """Least-squares polynomials over each row's valid neighbours, as weights on the values there.

    Gives the table ``(n, 4)`` of weights, where each row's part starts ``(M,)``, and per row the number of valid
    neighbours and the larger component of their mean offset over ``half`` ``(M,)``; -1 starts where no fit exists.
    Rows whose neighbours lie like those of the row before share its weights.

    ``normals`` ``(N, T, T)`` are normal matrices, T the terms of the higher order. With ``fresh`` those of the rows are
    entered; else they are there, over all neighbours, and what is missing is taken off.
    """
    total = 0
    for row in rows:
        total += indptr[row + 1] - indptr[row]
    table = np.empty((total, WEIGHTS))
    start = np.full(len(rows), -1, np.int64)
    count, offset = np.zeros(len(rows), np.int64), np.zeros(len(rows))
    most = max(order, depth_order)
    terms = terms_of(most)
    normal, lower, slopes = np.empty((terms, terms)), np.empty((terms, terms)), np.empty((WEIGHTS, terms))
    phi = np.empty(terms)
    used, last = 0, -1
    for m in range(len(rows)):
        row = rows[m]
        first, size = indptr[row], indptr[row + 1] - indptr[row]
        if last >= 0 and start[last] >= 0 and _alike(points, indptr, indices, valid, rows[last], row, half):
            start[m], count[m], offset[m] = start[last], count[last], offset[last]
            if fresh:
                normals[row] = normals[rows[last]]
            continue
        here = np.empty((size, 2))
        mean_x, mean_y = 0.0, 0.0
        for k in range(size):
            other = indices[first + k]
            here[k, 0] = (points[other, 0] - points[row, 0]) / half
            here[k, 1] = (points[other, 1] - points[row, 1]) / half
            if valid[other]:
                count[m] += 1
                mean_x += here[k, 0]
                mean_y += here[k, 1]
        known = valid[indices[first : first + size]]
        offset[m] = max(abs(mean_x), abs(mean_y)) / max(count[m], 1)
        if fresh or 2 * count[m] < size:
            normal[:] = 0.0
            _add_products(here, known, True, 1.0, most, phi, normal)
            if fresh:
                normals[row] = normal
        else:
            normal[:] = normals[row]
            _add_products(here, known, False, -1.0, most, phi, normal)
        slopes[:] = 0.0
        if _solve_slopes(normal, order, half, lower, slopes[:2]) and _solve_slopes(
            normal, depth_order, half, lower, slopes[2:]
        ):
            start[m] = used
            _weigh(here, known, most, phi, slopes, table[used : used + size])
            used += size
            last = m
    return table[:used].copy(), start, count, offset


@njit(cache=True, nogil=True)
def terms_of(order):
    """Terms of a polynomial in two variables."""
    return (order + 1) * (order + 2) // 2


@njit(cache=True, nogil=True)
def _alike(points, indptr, indices, valid, one, two, half):
    first, second = indptr[one], indptr[two]
    size = indptr[one + 1] - first
    if indptr[two + 1] - second != size:
        return False
    for k in range(size):
        a, b = indices[first + k], indices[second + k]
        if valid[a] != valid[b]:
            return False
        for c in range(2):
            if abs(points[a, c] - points[one, c] - points[b, c] + points[two, c]) > _SAME * half:
                return False
    return True


@njit(cache=True, nogil=True)
def _basis(x, y, order, out):
    """Monomials x^i y^j, i + j <= order: 1, x, y, x^2, x y, y^2, ..."""
    out[0] = 1.0
    begin, m = 0, 1
    for degree in range(1, order + 1):
        for k in range(degree):
            out[m] = out[begin + k] * x
            m += 1
        out[m] = out[begin + degree - 1] * y
        m += 1
        begin += degree


@njit(cache=True, nogil=True)
def _add_products(here, known, which, sign, order, phi, normal):
    """Add ``sign`` times the products of the terms at the points that are ``which``; the lower half of a matrix.

    That of a lower order is its first corner.
    """
    for k in range(len(here)):
        if known[k] == which:
            _basis(here[k, 0], here[k, 1], order, phi)
            for a in range(len(phi)):
                share = sign * phi[a]
                for b in range(a + 1):
                    normal[a, b] += share * phi[b]


@njit(cache=True, nogil=True)
def _solve_slopes(normal, order, half, lower, slopes):
    """The two first derivatives at the origin as weights ``(2, T)`` of the terms; False where singular."""
    terms = terms_of(order)
    scale = np.empty(terms)
    for a in range(terms):
        if not normal[a, a] > 0.0:
            return False
        scale[a] = 1.0 / math.sqrt(normal[a, a])
    for a in range(terms):  # Cholesky, scaled to a unit diagonal
        for b in range(a + 1):
            total = normal[a, b] * scale[a] * scale[b]
            for k in range(b):
                total -= lower[a, k] * lower[b, k]
            if a == b:
                if total <= _SINGULAR:
                    return False
                lower[a, a] = math.sqrt(total)
            else:
                lower[a, b] = total / lower[b, b]
    for c in range(2):
        slopes[c, c + 1] = scale[c + 1]
        for a in range(terms):
            for k in range(a):
                slopes[c, a] -= lower[a, k] * slopes[c, k]
            slopes[c, a] /= lower[a, a]
        for a in range(terms - 1, -1, -1):
            for k in range(a + 1, terms):
                slopes[c, a] -= lower[k, a] * slopes[c, k]
            slopes[c, a] /= lower[a, a]
        slopes[c, :terms] *= scale / half
    return True


@njit(cache=True, nogil=True)
def _weigh(here, known, order, phi, slopes, weights):
    """Weights ``(n, 4)`` of the points, 0 for unknown ones."""
    for k in range(len(here)):
        weights[k] = 0.0
        if known[k]:
            _basis(here[k, 0], here[k, 1], order, phi)
            for w in range(WEIGHTS):
                total = 0.0
                for a in range(len(phi)):
                    total += slopes[w, a] * phi[a]
                weights[k, w] = total


@njit(cache=True, nogil=True)
def apply_rows(values, indptr, indices, rows, table, start, out):
    """Weighted sums of values ``(N, 3)`` over each row's neighbours into ``out`` ``(N, 3, 4)``; no NaN among them."""
    for m in range(len(rows)):
        if start[m] < 0:
            continue
        row, first = rows[m], indptr[rows[m]]
        sums = np.zeros((3, WEIGHTS))
        for k in range(indptr[row + 1] - first):
            other, weight = indices[first + k], start[m] + k
            for c in range(3):
                value = values[other, c]
                for w in range(WEIGHTS):
                    sums[c, w] += table[weight, w] * value
        out[row] = sums


@njit(cache=True, nogil=True)
def mean_rows(values, indptr, indices, rows, table, start, out):
    """Means of values ``(N, 3)`` into ``out`` ``(N, 3)``, weighted as noise there weighs in the first derivatives."""
    for m in range(len(rows)):
        if start[m] < 0:
            continue
        row, first = rows[m], indptr[rows[m]]
        sums, total = np.zeros(3), 0.0
        for k in range(indptr[row + 1] - first):
            weight = start[m] + k
            share = table[weight, 0] ** 2 + table[weight, 1] ** 2
            total += share
            for c in range(3):
                sums[c] += share * values[indices[first + k], c]
        out[row] = sums / total


@njit(cache=True, nogil=True)
def square_rows(indptr, rows, table, start, out):
    """Sums of squared weights into ``out`` ``(N, 4)``: the variance of the weighted sums for independent unit noise."""
    for m in range(len(rows)):
        if start[m] < 0:
            continue
        row = rows[m]
        sums = np.zeros(WEIGHTS)
        for k in range(start[m], start[m] + indptr[row + 1] - indptr[row]):
            for w in range(WEIGHTS):
                sums[w] += table[k, w] ** 2
        out[row] = sums


@njit(cache=True, nogil=True)
def noise_rows(points, indptr, indices, rows, table, start, subset, out):
    """Covariance ``(N, 4, 4)`` of the weighted sums for noise of unit variance, into ``out``.

    Points whose subsets of ``subset`` px overlap share pixels, and as large a part of their noise; 0: independent.
    """
    last = -1
    for m in range(len(rows)):
        if start[m] < 0:
            continue
        row, first = rows[m], indptr[rows[m]]
        if last >= 0 and start[m] == start[last]:
            out[row] = out[rows[last]]
            continue
        last = m
        size = indptr[row + 1] - first
        sums = np.zeros((WEIGHTS, WEIGHTS))
        for k in range(size):
            one, weight = indices[first + k], start[m] + k
            for j in range(k + 1):
                two, other = indices[first + j], start[m] + j
                if j == k:
                    shared = 0.5
                else:
                    across, down = abs(points[one, 0] - points[two, 0]), abs(points[one, 1] - points[two, 1])
                    if across >= subset or down >= subset:
                        continue
                    shared = (1.0 - across / subset) * (1.0 - down / subset)
                for a in range(WEIGHTS):
                    for b in range(WEIGHTS):
                        sums[a, b] += shared * table[weight, a] * table[other, b]
        out[row] = sums + sums.T
