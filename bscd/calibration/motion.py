"""How the stages move the target, measured in the world frame: a rotation axis and a translation direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from bscd.arrays import FloatArray


@dataclass(frozen=True)
class TargetMotion:
    """The target's rigid motion against its corner pose at POS.0.

    ``direction`` ``(3,)``: unit vector of a positive translation. ``face_rotation`` ``(3,)`` (rotation vector, rad)
    and ``face_translation_mm`` ``(3,)`` carry the corner pose into the face pose at POS.0. The two readings of the
    rotation stage, in degrees, belong to these poses.
    """

    direction: FloatArray
    face_rotation: FloatArray
    face_translation_mm: FloatArray
    corner_reading_deg: float
    face_reading_deg: float

    @property
    def axis(self) -> FloatArray:
        """Unit vector ``(3,)`` of the rotation axis; a positive reading turns counter-clockwise about it."""
        unit = self.face_rotation / np.linalg.norm(self.face_rotation)
        return unit if self.face_reading_deg > self.corner_reading_deg else -unit

    @property
    def axis_point_mm(self) -> FloatArray:
        """The point ``(3,)`` of the rotation axis that is nearest to the world's origin (at POS.0)."""
        unit = self.axis
        across = self.face_translation_mm - unit * (unit @ self.face_translation_mm)
        return np.linalg.lstsq(np.eye(3) - Rotation.from_rotvec(self.face_rotation).as_matrix(), across, rcond=None)[0]

    def points_mm(self, points_mm: FloatArray, rotation_deg: float, y_mm: FloatArray | float) -> FloatArray:
        """Where target points ``(N, 3)`` (corner pose, POS.0) are for these stage readings; ``(N, 3)`` mm.

        Between and beyond the two measured poses the target turns about the measured axis.
        """
        fraction = (rotation_deg - self.corner_reading_deg) / (self.face_reading_deg - self.corner_reading_deg)
        turned = Rotation.from_rotvec(self.face_rotation * fraction).as_matrix()
        point = self.axis_point_mm
        slide = self.axis * (self.axis @ self.face_translation_mm) * fraction
        shifted = np.multiply.outer(np.asarray(y_mm, np.float64), self.direction)
        return (points_mm - point) @ turned.T + point + slide + shifted
