"""The rigid motion between two states of the same points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class RigidMotion:
    """A turn ``(3, 3)`` and then a shift ``(3,)`` in mm; NaN where it is not known."""

    rotation: FloatArray
    translation_mm: FloatArray

    def apply(self, points_mm: FloatArray) -> FloatArray:
        """Points ``(N, 3)`` after the motion."""
        return points_mm @ self.rotation.T + self.translation_mm


def rigid_motion(points_mm: FloatArray, onto_mm: FloatArray) -> RigidMotion:
    """The motion that brings points ``(N, 3)`` closest to others, over those known in both; least squares.

    Kabsch, Acta Cryst. A 32, 1976. Not known with fewer than three points.
    """
    known = np.all(np.isfinite(points_mm) & np.isfinite(onto_mm), axis=1)
    if np.count_nonzero(known) < 3:
        return RigidMotion(np.full((3, 3), np.nan), np.full(3, np.nan))
    centre_mm, onto_centre_mm = points_mm[known].mean(axis=0), onto_mm[known].mean(axis=0)
    left, _, right = np.linalg.svd((onto_mm[known] - onto_centre_mm).T @ (points_mm[known] - centre_mm))
    mirror = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    rotation = left @ mirror @ right
    return RigidMotion(rotation, onto_centre_mm - rotation @ centre_mm)
