"""The kernels of triangulation: a point from its images, and how its images' noise passes on to it."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def triangulate_points(matrices, images, steps, converged_mm, xyz, residual, jacobian):
    """Points from images ``(N, V, 2)`` in cameras ``(V, 3, 4)``, into ``xyz`` ``(N, 3)``.

    The linear solution, then ``steps`` of Gauss-Newton on the reprojection error at most; the last one is shorter than
    ``converged_mm``. ``residual`` ``(N, V, 2)`` and ``jacobian`` ``(N, 3, 2V)`` as `Triangulated` has them.
    """
    views = len(matrices)
    normal, inverse, right = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    off, design = np.empty(2 * views), np.empty((2 * views, 3))
    for n in range(len(images)):
        point = xyz[n]
        _multiplied_out(matrices, images[n], off, design)
        _normal_equations(off, design, normal, right)
        invert(normal, inverse)
        for a in range(3):
            point[a] = inverse[a, 0] * right[0] + inverse[a, 1] * right[1] + inverse[a, 2] * right[2]
        for _ in range(steps):
            _linearise(matrices, images[n], point, off, design)
            _normal_equations(off, design, normal, right)
            invert(normal, inverse)
            largest = 0.0
            for a in range(3):
                step = inverse[a, 0] * right[0] + inverse[a, 1] * right[1] + inverse[a, 2] * right[2]
                point[a] += step
                largest = max(largest, abs(step))
            if not largest > converged_mm:
                break
        _linearise(matrices, images[n], point, off, design)
        _normal_equations(off, design, normal, right)
        invert(normal, inverse)
        for k in range(2 * views):
            residual[n, k // 2, k % 2] = off[k]
            for a in range(3):
                jacobian[n, a, k] = (
                    inverse[a, 0] * design[k, 0] + inverse[a, 1] * design[k, 1] + inverse[a, 2] * design[k, 2]
                )


@njit(cache=True, nogil=True, error_model="numpy")
def _multiplied_out(matrices, image, right, left):
    """Equation 2 of the paper, multiplied out: ``left`` ``(2V, 3)`` times the point is ``right`` ``(2V,)``."""
    for v in range(len(matrices)):
        m = matrices[v]
        for i in range(2):
            for a in range(3):
                left[2 * v + i, a] = image[v, i] * m[2, a] - m[i, a]
            right[2 * v + i] = m[i, 3] - image[v, i] * m[2, 3]


@njit(cache=True, nogil=True, error_model="numpy")
def _linearise(matrices, image, point, off, design):
    """Measured minus reprojected ``(2V,)``, and the reprojection's derivatives ``(2V, 3)`` by the point."""
    for v in range(len(matrices)):
        m = matrices[v]
        depth = m[2, 0] * point[0] + m[2, 1] * point[1] + m[2, 2] * point[2] + m[2, 3]
        for i in range(2):
            place = (m[i, 0] * point[0] + m[i, 1] * point[1] + m[i, 2] * point[2] + m[i, 3]) / depth
            off[2 * v + i] = image[v, i] - place
            for a in range(3):
                design[2 * v + i, a] = (m[i, a] - place * m[2, a]) / depth


@njit(cache=True, nogil=True, error_model="numpy")
def _normal_equations(off, design, normal, right):
    for a in range(3):
        total = 0.0
        for k in range(len(off)):
            total += design[k, a] * off[k]
        right[a] = total
        for b in range(a + 1):
            total = 0.0
            for k in range(len(off)):
                total += design[k, a] * design[k, b]
            normal[a, b] = normal[b, a] = total


@njit(cache=True, nogil=True, error_model="numpy")
def invert(normal, inverse):
    """The inverse of a symmetric ``(3, 3)`` matrix by Cramer's rule; NaN where it is not finite or singular.

    The matrix is scaled by its largest element, so that no determinant over- or underflows.
    """
    scale = 0.0
    for i in range(3):
        for j in range(i, 3):
            scale = max(scale, abs(normal[i, j]))
    a, b, c = normal[0, 0] / scale, normal[0, 1] / scale, normal[0, 2] / scale
    d, e, f = normal[1, 1] / scale, normal[1, 2] / scale, normal[2, 2] / scale
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = d * f - e * e, c * e - b * f, b * e - c * d
    inverse[1, 1], inverse[1, 2], inverse[2, 2] = a * f - c * c, b * c - a * e, a * d - b * b
    share = 1.0 / ((a * inverse[0, 0] + b * inverse[0, 1] + c * inverse[0, 2]) * scale)
    finite = True
    for i in range(3):
        for j in range(i, 3):
            inverse[i, j] *= share
            inverse[j, i] = inverse[i, j]
            finite = finite and math.isfinite(inverse[i, j])
    if not finite:
        inverse[:] = math.nan


@njit(cache=True, nogil=True)
def covariances(jacobian, covariance, out):
    """``J C J^T`` of ``(N, 3, K)`` and ``(N, K, K)`` into ``out`` ``(N, 3, 3)``."""
    views = jacobian.shape[2]
    half = np.empty(views)
    for n in range(len(out)):
        for a in range(3):
            for k in range(views):
                half[k] = 0.0
                for i in range(views):
                    half[k] += jacobian[n, a, i] * covariance[n, i, k]
            for b in range(3):
                total = 0.0
                for k in range(views):
                    total += half[k] * jacobian[n, b, k]
                out[n, a, b] = total
