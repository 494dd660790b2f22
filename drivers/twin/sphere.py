"""Where a ray hits the speckled sphere."""

from __future__ import annotations

import numpy as np
from numba import njit

from drivers.twin.optics import FloatArray


@njit(cache=True)
def hit_sphere(ox, oy, oz, dx, dy, dz, radius):
    """Where a ray (sphere's frame, unit direction, mm) first meets the sphere.

    Returns (what, u, v, x, y, z, nx, ny, nz) as `hit_membrane`: (u, v) is the material point in the azimuthal
    equidistant chart about the front pole -y (arc length and azimuth), smooth all over the visible cap.
    """
    along = ox * dx + oy * dy + oz * dz
    px, py, pz = ox - along * dx, oy - along * dy, oz - along * dz
    inside = radius * radius - (px * px + py * py + pz * pz)
    if inside <= 0.0 or along >= 0.0:
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
    back = np.sqrt(inside)
    x, y, z = px - back * dx, py - back * dy, pz - back * dz
    nx, ny, nz = x / radius, y / radius, z / radius
    sine = np.sqrt(nx * nx + nz * nz)
    arc = radius * (np.arctan2(sine, -ny) / sine if sine > 1e-12 else 1.0)
    return 1, arc * nx, arc * nz, x, y, z, nx, ny, nz


def sphere_points(material_mm: FloatArray, radius_mm: float) -> FloatArray:
    """Places ``(N, 3)`` mm in the sphere's frame of material points ``(N, 2)`` mm: the inverse of the chart."""
    u, v = np.asarray(material_mm, float).reshape(-1, 2).T
    arc = np.hypot(u, v)
    angle = arc / radius_mm
    scale = radius_mm * np.divide(np.sin(angle), arc, out=np.full_like(arc, 1.0 / radius_mm), where=arc > 0.0)
    return np.stack([u * scale, -radius_mm * np.cos(angle), v * scale], axis=-1)
