"""A cylinder's radius from its outlines in the photographs: nothing is matched, only edges are seen."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from scipy.optimize import least_squares

from bscd.arrays import FloatArray

#: Rows in which no light strip meets the cylinder's edges.
_ROWS = np.concatenate([np.arange(*part, 6) for part in ((520, 950), (1120, 1400), (1700, 2000), (2150, 2480))])

#: How far from the expected outline its edge is looked for, at first and later, px; slopes of less are no edge.
_REACHES_PX = (18, 10, 10, 10)
_LEAST_SLOPE = 8.0

_MIDDLE_MM = 120.0
_START = (0.0, -4.0, 0.0, 0.0, 57.0)


def outline_radius_mm(matrices: Mapping[int, FloatArray], grey: Mapping[int, FloatArray]) -> float:
    """The radius of a cylinder near the z axis that each camera ``(3, 4)`` sees in its image ``(H, W)``."""
    slopes = {
        c: np.gradient(cv2.GaussianBlur(np.asarray(image, float), (0, 0), 2.0), axis=1) for c, image in grey.items()
    }
    found = np.array(_START)
    for reach_px in _REACHES_PX:
        expected = {camera: _outlines(matrices[camera], found) for camera in grey}
        edges = {camera: _edges(slopes[camera], expected[camera], reach_px) for camera in grey}

        def off(parameters: FloatArray, edges: Mapping[int, FloatArray] = edges) -> FloatArray:
            return np.nan_to_num(
                np.concatenate([(_outlines(matrices[c], parameters) - edges[c]).ravel() for c in edges])
            )

        found = least_squares(off, found, loss="soft_l1", f_scale=2.0, x_scale=(1.0, 1.0, 0.01, 0.01, 1.0)).x
    return float(found[4])


def _outlines(matrix: FloatArray, parameters: FloatArray) -> FloatArray:
    """Columns ``(2, rows)`` of a cylinder's left and right outline: where rays of the camera touch it."""
    middle = np.array([parameters[0], parameters[1], _MIDDLE_MM])
    axis = np.array([parameters[2], parameters[3], 1.0]) / np.hypot(1.0, np.hypot(*parameters[2:4]))
    centre = -np.linalg.solve(matrix[:, :3], matrix[:, 3])
    towards = (centre - middle) - ((centre - middle) @ axis) * axis
    distance = float(np.linalg.norm(towards))
    towards = towards / distance
    cosine = parameters[4] / distance
    heights = np.linspace(-20.0, 270.0, 200) - _MIDDLE_MM
    columns = []
    for side in (-1.0, 1.0):
        normal = cosine * towards + side * np.sqrt(1.0 - cosine**2) * np.cross(axis, towards)
        image = (middle + heights[:, None] * axis + parameters[4] * normal) @ matrix[:, :3].T + matrix[:, 3]
        pixels = image[:, :2] / image[:, 2:]
        order = np.argsort(pixels[:, 1])
        columns.append(np.interp(_ROWS, pixels[order, 1], pixels[order, 0]))
    return np.array(sorted(columns, key=np.mean))


def _edges(slope: FloatArray, expected: FloatArray, reach_px: int) -> FloatArray:
    """Columns ``(2, rows)`` of the steepest slope near the expected ones, to a part of a pixel; NaN without an edge."""
    edges = np.full(expected.shape, np.nan)
    for side, sign in enumerate((1.0, -1.0)):
        for i, (row, column) in enumerate(zip(_ROWS, np.rint(expected[side]).astype(int), strict=True)):
            part = sign * slope[row, column - reach_px : column + reach_px + 1]
            best = int(np.argmax(part))
            if part[best] >= _LEAST_SLOPE and 0 < best < 2 * reach_px:
                before, here, behind = part[best - 1 : best + 2]
                edges[side, i] = column - reach_px + best + 0.5 * (before - behind) / (before - 2.0 * here + behind)
    return edges
