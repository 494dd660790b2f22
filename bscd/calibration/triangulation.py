"""Triangulation from two or more views, linear or optimal, with its uncertainty; vectorised over points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bscd.arrays import BoolArray, FloatArray
from bscd.calibration.choices import TriangulationMethod
from bscd.calibration.triangulation_kernel import covariances, triangulate_points

_GAUSS_NEWTON_STEPS = 4

#: A step as small as this ends a point's iteration; the next one would be some thousand times smaller.
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
        count, _, images = self.jacobian.shape
        out = np.empty((count, 3, 3))
        covariances(self.jacobian, np.ascontiguousarray(np.broadcast_to(covariance_px2, (count, images, images))), out)
        return out

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
    images = np.ascontiguousarray(np.stack(xy_px, axis=1), np.float64)
    count, views = images.shape[:2]
    xyz, residual, jacobian = np.empty((count, 3)), np.empty(images.shape), np.empty((count, 3, 2 * views))
    steps = _GAUSS_NEWTON_STEPS if method == "optimal" else 0
    cameras = np.ascontiguousarray(np.stack(matrices), np.float64)
    triangulate_points(cameras, images, steps, _CONVERGED_MM, xyz, residual, jacobian)
    return Triangulated(xyz, residual, jacobian)
