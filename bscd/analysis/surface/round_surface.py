"""A circle (2D) or sphere (3D) that may be flat: one model whose curvature passes through zero without a pole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray


@dataclass(frozen=True)
class RoundSurface:
    """The circle or sphere through ``anchor`` ``(d,)`` with the unit ``normal`` ``(d,)`` there, d = 2 or 3.

    ``curvature`` (one over length) is positive where the normal points to the convex side and 0 for a line or plane;
    the centre is ``anchor - normal / curvature``. The parametrisation is that of Lukacs, Martin and Marshall,
    "Faithful least-squares fitting of spheres, cylinders, cones and tori" (ECCV 1998).
    """

    anchor: FloatArray
    normal: FloatArray
    curvature: float

    @classmethod
    def from_algebraic(cls, a: float, b: FloatArray, c: float, near: FloatArray) -> RoundSurface | None:
        """The surface a |x|^2 / 2 + b x + c = 0, anchored at the foot of ``near`` ``(d,)``; None where it is empty."""
        squared = float(b @ b) - 2.0 * a * c
        if not squared > 0.0:
            return None
        curvature = a / np.sqrt(squared)
        height = np.asarray((0.5 * a * near @ near + b @ near + c) / np.sqrt(squared))
        distance = float(true_distance(height, curvature))
        slope = b + a * near
        steepness = float(np.linalg.norm(slope))
        at_centre = steepness < 1e-9 * np.sqrt(squared)  # where any direction leads to a foot
        normal = np.eye(len(near))[0] if at_centre else slope / steepness
        return cls(near - distance * normal, normal, curvature)

    @property
    def centre(self) -> FloatArray:
        """Centre ``(d,)``; infinite for a flat surface."""
        return self.anchor - self.normal / self.curvature

    def anchored_at(self, point: FloatArray) -> RoundSurface:
        """The same surface, anchored at the foot of a point ``(d,)``; the point must not be the centre."""
        normal = self.normal + self.curvature * (point - self.anchor)
        normal = normal / np.linalg.norm(normal)
        return RoundSurface(point - self.distance(point[None, :])[0] * normal, normal, self.curvature)

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distances ``(N,)`` of points ``(N, d)``, positive on the normal's side."""
        from_anchor = points - self.anchor
        height = from_anchor @ self.normal + 0.5 * self.curvature * np.sum(from_anchor**2, axis=1)
        return true_distance(height, self.curvature)

    def derivatives(self, points: FloatArray) -> FloatArray:
        """Derivatives ``(N, d + 1)`` of the distances by a lift, the d - 1 turns of the normal, and the curvature."""
        from_anchor = points - self.anchor
        distance = self.distance(points)
        stretch = 1.0 + self.curvature * distance
        columns = [
            -(1.0 + self.curvature * (from_anchor @ self.normal)),
            *(from_anchor @ turn for turn in self.turns),
            0.5 * (np.sum(from_anchor**2, axis=1) - distance**2),
        ]
        return np.stack(columns, axis=1) / np.maximum(stretch, 1e-9)[:, None]

    def moved(self, step: FloatArray) -> RoundSurface:
        """The surface after a step ``(d + 1,)`` in the parameters of `derivatives`."""
        normal = self.normal + step[1:-1] @ self.turns
        anchor = self.anchor + step[0] * self.normal
        return RoundSurface(anchor, normal / np.linalg.norm(normal), self.curvature + float(step[-1]))

    @property
    def turns(self) -> FloatArray:
        """Unit vectors ``(d - 1, d)`` along the surface at the anchor: Householder's reflection of the axes."""
        reflected = self.normal.copy()
        reflected[0] += 1.0 if reflected[0] >= 0.0 else -1.0
        return np.eye(len(reflected))[1:] - np.outer(reflected[1:], reflected) * (2.0 / (reflected @ reflected))


def true_distance(height: FloatArray, curvature: FloatArray | float) -> FloatArray:
    """The distance d with curvature d^2 / 2 + d = height: exact, and finite for curvature 0."""
    return 2.0 * height / (1.0 + np.sqrt(np.maximum(1.0 + 2.0 * curvature * height, 0.0)))
