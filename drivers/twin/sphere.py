"""Where a ray hits the speckled sphere."""

from __future__ import annotations

import numpy as np
from numba import njit

from drivers.twin.optics import FloatArray


@njit(inline="always")
def hit_sphere(ox, oy, oz, dx, dy, dz, radius):
    """Where a ray (sphere's frame, unit direction, mm) first meets the sphere.

    Returns (what, u, v, x, y, z, nx, ny, nz) as `membrane_at`: (u, v) is the material point in Lambert's
    equal-area chart about the front pole -y, smooth all over the visible cap.
    """
    along = ox * dx + oy * dy + oz * dz
    px, py, pz = ox - along * dx, oy - along * dy, oz - along * dz
    inside = radius * radius - (px * px + py * py + pz * pz)
    hit = (inside > 0.0) & (along < 0.0)
    back = np.sqrt(max(inside, 0.0))
    x, y, z = px - back * dx, py - back * dy, pz - back * dz
    chart = np.sqrt(2.0 * radius / max(radius - y, 1e-9 * radius))
    nx, ny, nz = x / radius, y / radius, z / radius
    return 1.0 if hit else 0.0, x * chart, z * chart, x, y, z, nx, ny, nz


def sphere_points(material_mm: FloatArray, radius_mm: float) -> FloatArray:
    """Places ``(N, 3)`` mm in the sphere's frame of material points ``(N, 2)`` mm: the inverse of the chart."""
    u, v = np.asarray(material_mm, float).reshape(-1, 2).T
    part = (u * u + v * v) / (4.0 * radius_mm**2)
    scale = np.sqrt(1.0 - part)
    return np.stack([u * scale, -radius_mm * (1.0 - 2.0 * part), v * scale], axis=-1)
