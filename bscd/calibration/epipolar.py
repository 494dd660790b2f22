"""Where a point of one view may be in the other: its epipolar curve over a range of depths."""

from __future__ import annotations

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration.dlt import project


def at_depth(matrix: FloatArray, xy_px: FloatArray, y_mm: FloatArray) -> FloatArray:
    """World points ``(N, K, 3)`` mm that a camera ``(3, 4)`` sees at ``(N, 2)`` px, in planes y = ``y_mm`` ``(K,)``.

    Equation 2 of the paper multiplied out, solved for x and z.
    """
    rows = xy_px[:, :, None] * matrix[2] - matrix[:2]
    determinant = rows[:, 0, 0] * rows[:, 1, 2] - rows[:, 0, 2] * rows[:, 1, 0]
    right = -(rows[:, :, None, 1] * y_mm + rows[:, :, None, 3])
    x = (right[:, 0] * rows[:, 1, 2, None] - rows[:, 0, 2, None] * right[:, 1]) / determinant[:, None]
    z = (rows[:, 0, 0, None] * right[:, 1] - right[:, 0] * rows[:, 1, 0, None]) / determinant[:, None]
    return np.stack([x, np.broadcast_to(y_mm, x.shape), z], axis=2)


def epipolar_curve(left: FloatArray, right: FloatArray, xy_px: FloatArray, y_mm: FloatArray) -> FloatArray:
    """Images ``(N, K, 2)`` px in the right camera of what the left one sees at ``(N, 2)`` px, at depths ``(K,)`` mm."""
    return project(right, at_depth(left, xy_px, y_mm))
