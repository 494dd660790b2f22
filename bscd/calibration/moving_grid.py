"""A rigid grid that a stage moves along a straight line: its fit to measured points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from bscd.arrays import FloatArray

_ITERATIONS = 100


@dataclass(frozen=True)
class MovingGrid:
    """Rotation vector ``(3,)`` rad and translation ``(3,)`` mm of the grid at y = 0, unit direction ``(3,)``."""

    rotation: FloatArray
    translation_mm: FloatArray
    direction: FloatArray

    def points_mm(self, grid_mm: FloatArray, y_mm: FloatArray | float) -> FloatArray:
        """Where grid points ``(N, 3)`` are after displacements y ``(N,)`` or one for all."""
        moved = Rotation.from_rotvec(self.rotation).apply(grid_mm) + self.translation_mm
        return moved + np.multiply.outer(np.broadcast_to(y_mm, len(grid_mm)), self.direction)


def fit_moving_grid(grid_mm: FloatArray, xyz_mm: FloatArray, y_mm: FloatArray) -> MovingGrid:
    """Least-squares pose and direction for grid points, measured points (both ``(N, 3)`` mm) and y ``(N,)`` mm.

    Minimises ``|R g + t + y d - x|`` over R, t and the unit vector d, in turns until nothing changes.
    """
    fitted = MovingGrid(np.zeros(3), np.zeros(3), np.zeros(3))
    centred_y = y_mm - y_mm.mean()
    for _ in range(_ITERATIONS):
        still = xyz_mm - np.multiply.outer(y_mm, fitted.direction)
        centre = grid_mm.mean(axis=0)
        turn = Rotation.align_vectors(still - still.mean(axis=0), grid_mm - centre)[0]
        slope = centred_y @ (xyz_mm - turn.apply(grid_mm))
        slope = slope / np.linalg.norm(slope)
        shift = (xyz_mm - turn.apply(grid_mm) - np.multiply.outer(y_mm, slope)).mean(axis=0)
        change = np.abs(slope - fitted.direction).max()
        fitted = MovingGrid(turn.as_rotvec(), shift, slope)
        if change < 1e-13:
            break
    return fitted
