"""The calibrated volume: the convex hull of the control points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from bscd.arrays import BoolArray, FloatArray

_TOUCHING_MM = 1e-9


@dataclass(frozen=True)
class Hull:
    """A convex volume as half-spaces: ``equations`` ``(F, 4)``, n.x + offset <= 0 inside, n outward, mm."""

    equations: FloatArray

    @classmethod
    def around(cls, points_mm: FloatArray) -> Hull:
        """The convex hull of points ``(M, 3)`` mm."""
        return cls(np.unique(ConvexHull(points_mm).equations.round(12), axis=0))

    def contains(self, points_mm: FloatArray) -> BoolArray:
        """Which of ``(N, 3)`` points lie in it; a NaN does not."""
        distance = self.equations[:, :3] @ points_mm.T
        distance += self.equations[:, 3:]
        return distance.max(axis=0) <= _TOUCHING_MM
