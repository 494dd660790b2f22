"""Triangulation in plain NumPy, all points at once: what `bscd.calibration.triangulation` must compute."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration.dlt import project
from bscd.calibration.triangulation import Triangulated

GAUSS_NEWTON_STEPS = 4


def triangulate(matrices: Sequence[FloatArray], xy_px: Sequence[FloatArray], method: str) -> Triangulated:
    """Of the same arguments as `bscd.calibration.triangulate`; all steps for all points."""
    points = _linear(matrices, xy_px)
    measured = np.stack(xy_px, axis=1)
    for _ in range(GAUSS_NEWTON_STEPS if method == "optimal" else 0):
        residual, design = _linearise(matrices, measured, points)
        points = points + np.einsum("nij,nj->ni", _pseudo_inverse(design), residual)
    residual, design = _linearise(matrices, measured, points)
    return Triangulated(points, residual.reshape(measured.shape), _pseudo_inverse(design))


def _linear(matrices: Sequence[FloatArray], xy_px: Sequence[FloatArray]) -> FloatArray:
    """The least-squares solution ``(N, 3)`` of equation 2 multiplied out, for all views together."""
    rows = [xy[:, :, None] * matrix[2] - matrix[:2] for matrix, xy in zip(matrices, xy_px, strict=True)]
    system = np.concatenate(rows, axis=1)
    left, right = system[:, :, :3], -system[:, :, 3]
    normal = np.swapaxes(left, 1, 2) @ left
    return _solve(normal, np.einsum("nij,ni->nj", left, right))


def projection_jacobian(matrix: FloatArray, points_mm: FloatArray) -> FloatArray:
    """Derivatives ``(..., 2, 3)`` px/mm of `project` by the point."""
    image = points_mm @ matrix[:, :3].T + matrix[:, 3]
    xy = image[..., :2] / image[..., 2:]
    return (matrix[:2, :3] - xy[..., :, None] * matrix[2, :3]) / image[..., 2, None, None]


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
    """Systems ``(N, 3, 3)`` with right sides ``(N, 3)`` or ``(N, 3, K)``; NaN where not finite."""
    solved = np.full(right.shape, np.nan)
    known = np.isfinite(normal).all(axis=(1, 2))
    if right.ndim == 3:
        solved[known] = np.linalg.solve(normal[known], right[known])
    else:
        solved[known] = np.linalg.solve(normal[known], right[known, :, None])[:, :, 0]
    return solved
