"""The surface that the requested points span: triangles on the grid, none across a hole."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay, KDTree, QhullError

from bscd.arrays import FloatArray, IntArray

#: Longest edge of a triangle in steps of the grid: a diagonal is 1.41, across a missing point it is 2.
_LONGEST_STEPS = 1.5


def triangulate(points_px: FloatArray) -> IntArray:
    """Triangles ``(M, 3)`` between neighbouring points ``(N, 2)`` of a grid; empty when there is none.

    The step is the median distance to the nearest neighbour. Corners run counter-clockwise as the camera sees
    them (columns to the right, rows down), so normals point at the camera.
    """
    none = np.empty((0, 3), np.int64)
    if len(points_px) < 3:
        return none
    try:
        corners = Delaunay(points_px).simplices.astype(np.int64)
    except QhullError:  # all on one line
        return none
    nearest_px, _ = KDTree(points_px).query(points_px, k=2)
    edges_px = points_px[corners] - points_px[np.roll(corners, 1, axis=1)]
    longest_px = np.linalg.norm(edges_px, axis=2).max(axis=1)
    corners = corners[longest_px <= _LONGEST_STEPS * np.median(nearest_px[:, 1])]
    (ax, ay), (bx, by) = (np.moveaxis(points_px[corners[:, k]] - points_px[corners[:, 0]], 1, 0) for k in (1, 2))
    clockwise = ax * by - ay * bx > 0.0  # rows run down
    corners[clockwise] = corners[clockwise][:, [0, 2, 1]]
    return corners
