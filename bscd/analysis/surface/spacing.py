"""How densely points lie."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay

from bscd.arrays import FloatArray


def spread_over_area(points: FloatArray) -> bool:
    """Whether points ``(N, 2)`` can be triangulated: four or more, not all on a line."""
    if len(points) < 4:
        return False
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(extent[1] > 1e-9 * extent[0])


def point_spacing(points: FloatArray) -> float:
    """Spacing of points ``(N, 2)``: the step of a square grid; of irregular points, that of as dense a grid.

    From the median area of the triangles between them, of which a square has two.
    """
    corners = points[Delaunay(points).simplices]
    edges = corners[:, 1:] - corners[:, :1]
    doubled = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    return float(np.sqrt(np.median(doubled)))


def surface_scale(points_px: FloatArray, xyz_mm: FloatArray) -> float:
    """Scale in mm/px on the surface: median over the edges between neighbouring points ``(N, 2)`` px, ``(N, 3)`` mm."""
    corners = Delaunay(points_px).simplices
    one, two = corners.ravel(), np.roll(corners, 1, axis=1).ravel()
    lengths = np.linalg.norm(xyz_mm[one] - xyz_mm[two], axis=1) / np.linalg.norm(
        points_px[one] - points_px[two], axis=1
    )
    return float(np.median(lengths))
