"""What a pair of views is: its matrices, its stereo angle and its distance to the object."""

from __future__ import annotations

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration import Calibration
from bscd.results import StereoSource


def view_matrices(calibration: Calibration, stereo: StereoSource) -> tuple[FloatArray, FloatArray]:
    """The projection matrices ``(3, 4)`` of a pair of views."""
    if stereo == "biprism":
        return calibration.left.matrix, calibration.right.matrix
    return calibration.reference["primary"].matrix, calibration.reference["auxiliary"].matrix


def centre_mm(matrix: FloatArray) -> FloatArray:
    """The centre of projection ``(3,)`` of a camera: the null vector of its matrix."""
    vector = np.linalg.svd(matrix)[2][-1]
    return vector[:3] / vector[3]


def stereo_angle_deg(matrices: tuple[FloatArray, FloatArray], at_mm: FloatArray) -> float:
    """The angle at a point ``(3,)`` between the lines to both centres of projection."""
    lines = [centre_mm(matrix) - at_mm for matrix in matrices]
    one, two = (line / np.linalg.norm(line) for line in lines)
    return float(np.degrees(np.arccos(np.clip(one @ two, -1.0, 1.0))))


def distance_mm(matrix: FloatArray, at_mm: FloatArray) -> float:
    """From a camera's centre of projection to a point ``(3,)``."""
    return float(np.linalg.norm(centre_mm(matrix) - at_mm))
