"""A physical camera: pinhole with Brown-Conrady lens distortion, for the adjustment of the reference pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import rq
from scipy.spatial.transform import Rotation

from bscd.arrays import AnalyticArray, FloatArray

#: fx, fy, cx, cy (px), k1, k2, p1, p2, rotation vector (rad), translation (mm)
CAMERA_PARAMETERS = 14

#: Each step leaves the lens's distortion, a small share, of the error before.
_INVERSE_STEPS = 20


@dataclass(frozen=True)
class LensCamera:
    """A pinhole camera with lens distortion k1, k2, p1, p2 (the forward model of OpenCV).

    ``parameters`` ``(14,)``: fx, fy, cx, cy in px, k1, k2, p1, p2, rotation vector in rad and translation in mm
    from the world to the camera (x along columns, y along rows, z forward).
    """

    parameters: FloatArray

    @classmethod
    def from_matrix(cls, matrix: FloatArray) -> LensCamera:
        """The camera of a projection matrix ``(3, 4)``, without distortion (and without its skew)."""
        upper, rotation = rq(matrix[:, :3])
        signs = np.diag(np.sign(np.diag(upper)))
        upper, rotation = upper @ signs, signs @ rotation
        translation = np.linalg.solve(upper, matrix[:, 3])
        if np.linalg.det(rotation) < 0:  # a projection matrix has no sign
            rotation, translation = -rotation, -translation
        upper = upper / upper[2, 2]
        vector = Rotation.from_matrix(rotation).as_rotvec()
        intrinsic = [upper[0, 0], upper[1, 1], upper[0, 2], upper[1, 2]]
        return cls(np.concatenate([intrinsic, np.zeros(4), vector, translation]))

    def project(self, points_mm: FloatArray) -> FloatArray:
        """Images ``(N, 2)`` px of points ``(N, 3)`` mm."""
        return np.real(project_lens(self.parameters, points_mm))

    @property
    def pinhole(self) -> FloatArray:
        """The projection matrix ``(3, 4)`` of the same camera with a perfect lens."""
        fx, fy, cx, cy = self.parameters[:4]
        rotation = np.real(rotation_matrix(self.parameters[8:11]))
        outer = np.column_stack([rotation, self.parameters[11:14]])
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]) @ outer

    def distorted_px(self, ideal_px: FloatArray) -> FloatArray:
        """Where the lens puts what a perfect lens would put at ``ideal_px`` ``(..., 2)``."""
        middle, scale = self.parameters[2:4], self.parameters[:2]
        return np.real(_brown(self.parameters[4:8], (ideal_px - middle) / scale)) * scale + middle

    def ideal_px(self, seen_px: FloatArray) -> FloatArray:
        """Where a perfect lens would put what is seen at ``seen_px`` ``(..., 2)``; the inverse of `distorted_px`."""
        middle, scale = self.parameters[2:4], self.parameters[:2]
        seen = (seen_px - middle) / scale
        ideal = seen
        for _ in range(_INVERSE_STEPS):
            ideal = ideal + seen - np.real(_brown(self.parameters[4:8], ideal))
        return ideal * scale + middle


def rotation_matrix(vector: AnalyticArray) -> AnalyticArray:
    """Rodrigues' formula; analytic in the vector, so that it also serves a complex step."""
    squared = np.sum(vector * vector)
    angle = np.sqrt(squared + 1e-60)
    cross = np.array(
        [[0.0, -vector[2], vector[1]], [vector[2], 0.0, -vector[0]], [-vector[1], vector[0], 0.0]],
        dtype=vector.dtype,
    )
    return np.eye(3) + np.sin(angle) / angle * cross + 2.0 * (np.sin(angle / 2) / angle) ** 2 * (cross @ cross)


def project_lens(parameters: AnalyticArray, points_mm: AnalyticArray) -> AnalyticArray:
    """`LensCamera.project` as a function; accepts complex numbers (for exact derivatives by a complex step)."""
    fx, fy, cx, cy, k1, k2, p1, p2 = parameters[:8]
    local = points_mm @ rotation_matrix(parameters[8:11]).T + parameters[11:14]
    bent = _brown((k1, k2, p1, p2), local[:, :2] / local[:, 2:])
    return np.stack([fx * bent[:, 0] + cx, fy * bent[:, 1] + cy], axis=1)


def _brown(coefficients: Sequence[Any] | AnalyticArray, ideal: AnalyticArray) -> AnalyticArray:
    """Distorted coordinates ``(..., 2)`` of ideal ones, both over the focal length."""
    k1, k2, p1, p2 = coefficients
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * k2)
    column = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    row = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.stack([column, row], axis=-1)
