"""Surfaces and deformations whose geometry is known in closed form."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.spatial.transform import Rotation

from drivers.twin.membrane import Membrane
from drivers.twin.options import MembraneOptions

SCALE_MM = 0.0554  # of a pixel: the paper's rig
MEMBRANE = Membrane(MembraneOptions())
WINDOW_MM = 15.0

#: Rows x', y', z' of a membrane that faces the camera: z' is -y of the world, y' is its z.
FACING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def cap(count, half_deg, rng, radius=18.265, centre=(0.6, 13.0, 0.5)):
    """Points spread evenly over a sphere's cap about -y, and their outward normals."""
    along = 1.0 - rng.random(count) * (1.0 - np.cos(np.radians(half_deg)))
    phi = rng.uniform(0.0, 2.0 * np.pi, count)
    across = np.sqrt(1.0 - along**2)
    normals = np.stack([across * np.cos(phi), -along, across * np.sin(phi)], axis=1)
    return np.asarray(centre) + radius * normals, normals


def grid(half_points, step_px=5.0):
    """A square grid of pixels about 0, rows from above; and where it is on a plane facing the camera, mm."""
    line = np.arange(-half_points, half_points + 1) * step_px
    column, row = (axis.ravel() for axis in np.meshgrid(line, line))
    points_px = np.stack([column, row], axis=1)
    return points_px, SCALE_MM * np.stack([column, 0.0 * column, -row], axis=1)


def tensor(meridian, hoop, along_x, along_y):
    """exx, eyy, exy of principal strains along the meridian, whose components in x', y' are given, and across it."""
    return np.stack(
        [
            meridian * along_x**2 + hoop * along_y**2,
            meridian * along_y**2 + hoop * along_x**2,
            (meridian - hoop) * along_x * along_y,
        ],
        axis=1,
    )


class MembraneField:
    """The twin's membrane on a grid of the reference view (seen from afar), at 0.05 kPa and at a higher pressure."""

    def __init__(self, pressure_kpa, step_px, shift_px=(1.4, 0.6), edge_mm=0.58):
        line = np.arange(-60, 61) * step_px
        column, row = (axis.ravel() for axis in np.meshgrid(line + shift_px[0], line + shift_px[1]))
        x, y = SCALE_MM * column, -SCALE_MM * row
        self.radius_mm = np.hypot(x, y)
        inside = self.radius_mm < WINDOW_MM - edge_mm
        x, y, self.radius_mm = x[inside], y[inside], self.radius_mm[inside]
        self.points_px = np.stack([column, row], axis=1)[inside]
        start = MEMBRANE.meridian(0.05)
        at = self.radius_mm / WINDOW_MM
        phi = np.arctan2(y, x)
        material = np.stack([WINDOW_MM * CubicSpline(start.radius, start.material)(at), phi], axis=1)
        self.reference = MEMBRANE.positions(material, 0.05)
        self.current = MEMBRANE.positions(material, pressure_kpa)
        first, then = (1.0 + 2.0 * MEMBRANE.green_lagrange(material, p) for p in (0.05, pressure_kpa))
        meridian, hoop = ((then / first - 1.0) / 2.0).T
        slope = CubicHermiteSpline(start.radius, start.height, self._slope(start))(at, 1)
        along = np.stack([np.cos(phi), np.sin(phi), slope], axis=1) / np.hypot(1.0, slope)[:, None]
        around = np.stack([-np.sin(phi), np.cos(phi), 0.0 * phi], axis=1)
        normal = np.cross(along, around)
        first_axis = np.array([1.0, 0.0, 0.0]) - normal * normal[:, :1]
        first_axis /= np.linalg.norm(first_axis, axis=1, keepdims=True)
        along_x = np.sum(first_axis * along, axis=1)
        along_y = np.sum(np.cross(normal, first_axis) * along, axis=1)
        self.strain = tensor(meridian, hoop, along_x, along_y)

    @staticmethod
    def _slope(meridian):
        return -np.sqrt(1.0 - meridian.cos_slope**2) / meridian.cos_slope


def turned(vector_deg):
    """A rotation matrix of a rotation vector in degrees."""
    return Rotation.from_rotvec(vector_deg, degrees=True).as_matrix()
