"""The twin's optical elements: a camera with lens distortion and a biprism, as frozen models in the world frame.

The world frame is that of DESIGN section 2 (x right, y away from the camera, z up; mm). Pixel centres are on
integers, origin at the centre of the top-left pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

FloatArray = NDArray[np.float64]

#: Rows: a camera's axes (x along columns, y along rows, z forward) in the world when it looks along +y.
LOOKING_ALONG_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class CameraOptics:
    """A pinhole camera with lens distortion in Brown's original sense: from the measured to the ideal point.

    ``distortion`` is (k1, k2, p1, p2) on image coordinates over the focal length, as photogrammetry has it
    (Brown 1971; OpenCV's model goes the other way, so its k1 is about minus this one). DESIGN section 3's
    figures hold for k1 = -0.5 in this sense only.

    ``rotation`` ``(3, 3)``: rows are the camera's axes in the world; ``position_mm``: its centre of projection.
    ``principal_px`` is (column, row).
    """

    focal_length_mm: float
    pixel_size_mm: float
    width_px: int
    height_px: int
    principal_px: tuple[float, float]
    distortion: tuple[float, float, float, float]
    position_mm: tuple[float, float, float]
    rotation: FloatArray

    def packed(self) -> tuple[float, ...]:
        """All numbers in one tuple ``(21,)`` for the kernels of `drivers.twin.trace`."""
        scale = self.focal_length_mm / self.pixel_size_mm
        packed = np.concatenate(
            [
                [scale, scale],
                self.principal_px,
                self.distortion,
                self.position_mm,
                np.ravel(self.rotation),
                [1.0 / scale],
            ]
        )
        return tuple(packed.tolist())


@dataclass(frozen=True)
class Biprism:
    """A biprism: flat back face towards the camera, roof with the edge towards the object.

    In its own frame (x right, y forward, z up, origin in the middle of the edge) the back face is the plane
    y = -thickness and the roof is y = -|x| tan(beta), beta = (180 - alpha) / 2. ``edge_mm`` is the middle of the
    edge in the world, ``rotation`` ``(3, 3)`` has the prism's axes in the world as rows.
    """

    refractive_index: float
    alpha_deg: float
    thickness_mm: float
    width_mm: float
    height_mm: float
    edge_mm: tuple[float, float, float]
    rotation: FloatArray

    @property
    def base_angle_rad(self) -> float:
        """beta, the angle between the back face and either roof face."""
        return math.radians(180.0 - self.alpha_deg) / 2.0

    def packed(self) -> tuple[float, ...]:
        """All numbers in one tuple ``(19,)`` for the kernels of `drivers.twin.trace`."""
        beta = self.base_angle_rad
        head = [self.refractive_index, math.sin(beta), math.cos(beta), self.thickness_mm]
        size = [self.width_mm / 2.0, self.height_mm / 2.0]
        packed = np.concatenate([head, size, self.edge_mm, np.ravel(self.rotation), [1.0 / self.refractive_index]])
        return tuple(packed.tolist())


def rotation_xyz_deg(x_deg: float, y_deg: float, z_deg: float) -> FloatArray:
    """Rows: the axes of a body turned by x, then y, then z degrees about the world's axes, right-handed."""
    return Rotation.from_euler("xyz", [x_deg, y_deg, z_deg], degrees=True).as_matrix().T


def look_at(position_mm: FloatArray, target_mm: FloatArray, roll_deg: float = 0.0) -> FloatArray:
    """Rotation ``(3, 3)`` (rows: camera axes in the world) of an upright camera that looks at a point."""
    forward = np.asarray(target_mm, float) - np.asarray(position_mm, float)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    upright = np.stack([right, np.cross(forward, right), forward])
    return Rotation.from_rotvec([0.0, 0.0, math.radians(-roll_deg)]).as_matrix() @ upright
