"""Image shifts that make the reconstruction meet the reference points (paper, section 2.2.2, equation 3).

Three equations, four unknowns: the paper searches the shifts that bring the distance d to zero ("smallest": the
smallest such shifts); "projection" takes the images of the reference points in the virtual cameras.
"""

from __future__ import annotations

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration.choices import ShiftSolver, TriangulationMethod
from bscd.calibration.dlt import project
from bscd.calibration.triangulation import triangulate

#: Order of the four shifts in every array.
SHIFT_NAMES = ("u_L", "v_L", "u_R", "v_R")

_ITERATIONS = 20
_REACHED_MM = 1e-9


def solve_shifts(
    left_matrix: FloatArray,
    right_matrix: FloatArray,
    left_px: FloatArray,
    right_px: FloatArray,
    reference_mm: FloatArray,
    solver: ShiftSolver = "projection",
    triangulation: TriangulationMethod = "optimal",
) -> FloatArray:
    """Shifts ``(N, 4)`` px (u_L, v_L, u_R, v_R) that carry measured images to distortion-free ones.

    With them the triangulation of the shifted images ``left_px``, ``right_px`` ``(N, 2)`` is the reference point
    ``(N, 3)`` mm: d = 0 for either solver.
    """
    measured = np.concatenate([left_px, right_px], axis=1)
    ideal = np.concatenate([project(left_matrix, reference_mm), project(right_matrix, reference_mm)], axis=1)
    if solver == "projection":
        return ideal - measured
    return _smallest(left_matrix, right_matrix, measured, reference_mm, triangulation)


def _smallest(
    left_matrix: FloatArray,
    right_matrix: FloatArray,
    measured: FloatArray,
    reference: FloatArray,
    triangulation: TriangulationMethod,
) -> FloatArray:
    """The smallest shifts with d = 0, by sequential least-norm steps on the linearised constraint."""
    shifts = np.zeros_like(measured)
    for _ in range(_ITERATIONS):
        there = _meet(left_matrix, right_matrix, measured + shifts, triangulation)
        miss = reference - there
        slope = _slopes(left_matrix, right_matrix, measured + shifts, triangulation)
        # least-norm s with slope (s - shifts) = miss
        wanted = miss + np.einsum("nij,nj->ni", slope, shifts)
        shifts = np.einsum("nij,nj->ni", np.linalg.pinv(slope), wanted)
        if np.linalg.norm(miss, axis=1).max(initial=0.0) < _REACHED_MM:
            break
    return shifts


def _meet(left: FloatArray, right: FloatArray, images: FloatArray, method: TriangulationMethod) -> FloatArray:
    return triangulate([left, right], [images[:, :2], images[:, 2:]], method).xyz_mm


def _slopes(left: FloatArray, right: FloatArray, images: FloatArray, method: TriangulationMethod) -> FloatArray:
    """Derivatives ``(N, 3, 4)`` of the triangulated point by the four image coordinates, central differences."""
    step = 1e-2
    columns = [
        (_meet(left, right, images + step * unit, method) - _meet(left, right, images - step * unit, method))
        / (2 * step)
        for unit in np.eye(4)
    ]
    return np.stack(columns, axis=-1)
