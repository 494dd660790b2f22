"""Triangulation from two or more views, linear or optimal, with its uncertainty; vectorised over points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bscd.arrays import BoolArray, FloatArray
from bscd.calibration.dlt import project, projection_jacobian

TriangulationMethod = Literal["linear", "optimal"]

_GAUSS_NEWTON_STEPS = 4

_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))

#: A step as small as this ends the iteration; the next one would be some thousand times smaller.
_CONVERGED_MM = 1e-6


@dataclass(frozen=True)
class Triangulated:
    """Points and what follows from their views.

    ``xyz_mm`` ``(N, 3)``; ``residual_px`` ``(N, V, 2)``: measured minus reprojected; ``jacobian``
    ``(N, 3, 2V)`` mm/px: derivatives of the point by the image coordinates (view by view, column before row).
    """

    xyz_mm: FloatArray
    residual_px: FloatArray
    jacobian: FloatArray

    def covariance_mm2(self, covariance_px2: FloatArray) -> FloatArray:
        """Covariance ``(N, 3, 3)`` for image covariances ``(2V, 2V)`` or ``(N, 2V, 2V)``."""
        return self.jacobian @ covariance_px2 @ np.swapaxes(self.jacobian, 1, 2)

    def only(self, which: BoolArray) -> Triangulated:
        """Some of the points."""
        return Triangulated(self.xyz_mm[which], self.residual_px[which], self.jacobian[which])


def triangulate(
    matrices: Sequence[FloatArray], xy_px: Sequence[FloatArray], method: TriangulationMethod = "optimal"
) -> Triangulated:
    """Points ``(N, 3)`` from their images ``(N, 2)`` in each of V >= 2 cameras given as matrices ``(3, 4)``.

    "linear" solves the paper's equation 2, multiplied out, by least squares; "optimal" minimises the
    reprojection error. A NaN image gives a NaN point.
    """
    points = triangulate_linear(matrices, xy_px)
    measured = np.stack(xy_px, axis=1)
    steps = _GAUSS_NEWTON_STEPS if method == "optimal" else 0
    for _ in range(steps):
        residual, design = _linearise(matrices, measured, points)
        step = np.einsum("nij,nj->ni", _pseudo_inverse(design), residual)
        points = points + step
        if not np.any(np.abs(step) > _CONVERGED_MM):
            break
    residual, design = _linearise(matrices, measured, points)
    return Triangulated(points, residual.reshape(measured.shape), _pseudo_inverse(design))


def triangulate_linear(matrices: Sequence[FloatArray], xy_px: Sequence[FloatArray]) -> FloatArray:
    """The least-squares solution ``(N, 3)`` of equation 2 multiplied out, for all views together."""
    rows = [xy[:, :, None] * matrix[2] - matrix[:2] for matrix, xy in zip(matrices, xy_px, strict=True)]
    system = np.concatenate(rows, axis=1)
    left, right = system[:, :, :3], -system[:, :, 3]
    normal = np.swapaxes(left, 1, 2) @ left
    return _solve(normal, np.einsum("nij,ni->nj", left, right))


def _linearise(
    matrices: Sequence[FloatArray], measured: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    residual = np.concatenate([measured[:, v] - project(m, points) for v, m in enumerate(matrices)], axis=1)
    design = np.concatenate([projection_jacobian(m, points) for m in matrices], axis=1)
    return residual, design


def _pseudo_inverse(design: FloatArray) -> FloatArray:
    """(J^T J)^-1 J^T of ``(N, 2V, 3)``; NaN stays NaN."""
    normal = np.swapaxes(design, 1, 2) @ design
    return _solve(normal, np.swapaxes(design, 1, 2))


def _solve(normal: FloatArray, right: FloatArray) -> FloatArray:
    """Solve symmetric ``(N, 3, 3)`` systems by Cramer's rule; rows that are not finite or singular give NaN.

    The systems are scaled by their largest element, so that no determinant over- or underflows.
    """
    scale = np.abs(normal).max(axis=(1, 2))
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b, c, d, e, f = (normal[:, i, j] / scale for i, j in _UPPER)
        cofactors = (d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b)
        determinant = a * cofactors[0] + b * cofactors[1] + c * cofactors[2]
        share = 1.0 / (determinant * scale)
        inverse = np.empty_like(normal)
        for (i, j), cofactor in zip(_UPPER, cofactors, strict=True):
            inverse[:, i, j] = inverse[:, j, i] = cofactor * share
    inverse[~np.isfinite(inverse).all(axis=(1, 2))] = np.nan
    return inverse @ right if right.ndim == 3 else np.einsum("nij,nj->ni", inverse, right)
