"""Green-Lagrange strain of a surface from the derivatives of its points' positions by the image coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray


@dataclass(frozen=True)
class SurfaceGradient:
    """How a surface's tangent vectors map from the reference ``A`` ``(N, 3, 2)`` to the current state.

    ``tangents`` ``(N, 2, 3)`` are unit vectors t1, t2 in the reference's tangent plane, ``to_tangents`` ``(N, 2, 2)``
    the inverse of their components of A, and ``gradient`` ``(N, 3, 2)`` the deformation gradient F: the current
    image of a reference vector with components in t1, t2. All in the sense of curvilinear coordinates: Green and
    Zerna, "Theoretical Elasticity" (2nd ed., 1968).
    """

    tangents: FloatArray
    to_tangents: FloatArray
    gradient: FloatArray

    @classmethod
    def between(
        cls, reference: FloatArray, current: FloatArray, x_axis: FloatArray, outward: FloatArray | None
    ) -> SurfaceGradient:
        """From derivatives of positions by (column, row) ``(N, 3, 2)`` mm/px.

        t1 is the projection of ``x_axis`` ``(3,)`` into the tangent plane, t2 completes with the normal a right-handed
        set; the normal is on the side of ``outward`` ``(3,)``, or, without it, on that from which columns run to the
        right and rows down.
        """
        normal = np.cross(reference[:, :, 1], reference[:, :, 0])
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        if outward is not None:
            normal = normal * np.where(normal @ outward < 0.0, -1.0, 1.0)[:, None]
        first = x_axis - (normal @ x_axis)[:, None] * normal
        first = first / np.linalg.norm(first, axis=1, keepdims=True)
        tangents = np.stack([first, np.cross(normal, first)], axis=1)
        components = tangents @ reference
        swapped = components[:, ::-1, ::-1].swapaxes(1, 2) * np.array([[1.0, -1.0], [-1.0, 1.0]])
        determinant = components[:, 0, 0] * components[:, 1, 1] - components[:, 0, 1] * components[:, 1, 0]
        inverse = swapped / determinant[:, None, None]
        return cls(tangents, inverse, current @ inverse)

    @property
    def right_cauchy_green(self) -> FloatArray:
        """C = F^T F ``(N, 2, 2)``."""
        return self.gradient.swapaxes(1, 2) @ self.gradient

    def strain(self) -> FloatArray:
        """E = (C - 1) / 2 as exx, eyy, exy ``(N, 3)`` (exy is the tensor's component, half the shear angle)."""
        c = self.right_cauchy_green
        return np.stack([c[:, 0, 0] - 1.0, c[:, 1, 1] - 1.0, c[:, 0, 1]], axis=1) / 2.0

    def sensitivity(self) -> tuple[FloatArray, FloatArray]:
        """Derivatives ``(N, 3, 3, 2)`` of exx, eyy, exy by the current derivatives, and by the reference ones.

        From dE = sym(F^T (da - F T dA) J^-1), J^-1 = ``to_tangents``, T = ``tangents``; the turn of t1 about the normal
        is left out (it is of second order for a reference near the membrane's plane).
        """
        along = self.right_cauchy_green @ self.tangents
        return self._symmetric(self.gradient.swapaxes(1, 2)), -self._symmetric(along)

    def _symmetric(self, left: FloatArray) -> FloatArray:
        """(left_ic M_aj + left_jc M_ai) / 2 for ij = 11, 22, 12, of left ``(N, 2, 3)``."""
        pairs = [(0, 0), (1, 1), (0, 1)]
        m = self.to_tangents
        parts = [left[:, i, :, None] * m[:, None, :, j] + left[:, j, :, None] * m[:, None, :, i] for i, j in pairs]
        return 0.5 * np.stack(parts, axis=1)


def principal(strain: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Principal strains ``(..., 2)``, e1 >= e2, and the angle ``(...,)`` deg from t1 to e1's direction, -90 .. 90.

    ``strain`` ``(..., 3)``: exx, eyy, exy; Mohr's circle.
    """
    exx, eyy, exy = np.moveaxis(strain, -1, 0)
    middle, half = 0.5 * (exx + eyy), 0.5 * (exx - eyy)
    radius = np.hypot(half, exy)
    return np.stack([middle + radius, middle - radius], axis=-1), np.degrees(0.5 * np.arctan2(exy, half))
