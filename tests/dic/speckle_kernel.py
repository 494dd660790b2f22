"""The sum that a speckle image is: soft spots of paint over one another, with its exact gradient."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

BAND_ROWS = 32
"""Rows that one thread paints; fixed, so that images do not depend on the number of threads."""
REACH = 5.0
"""Radii to which a spot is painted; beyond it is below 2e-11 of its height."""


@njit(cache=True)
def _fade(t):
    """``exp(-t)`` for 0 <= t <= 60, absolute error below 1e-14; no library call, so the loop vectorises."""
    s = -t * (1.0 / 64.0)
    e = 1.0 / 39916800.0
    e = e * s + 1.0 / 3628800.0
    e = e * s + 1.0 / 362880.0
    e = e * s + 1.0 / 40320.0
    e = e * s + 1.0 / 5040.0
    e = e * s + 1.0 / 720.0
    e = e * s + 1.0 / 120.0
    e = e * s + 1.0 / 24.0
    e = e * s + 1.0 / 6.0
    e = e * s + 0.5
    e = e * s + 1.0
    e = e * s + 1.0
    for _ in range(6):
        e = e * e
    return e


@njit(cache=True, parallel=True, error_model="numpy")
def paint(material_x, material_y, spots, boxes):
    """Bare share ``prod(1 - a exp(-d^2 / r^2))`` ``(H, W)`` at the material points seen by the pixels.

    ``spots (N, 4)``: x, y, radius, height; ``boxes (N, 4)``: first and past-last column and row that each reaches.
    """
    rows, columns = material_x.shape
    bare = np.ones((rows, columns))
    for band in prange((rows + BAND_ROWS - 1) // BAND_ROWS):
        first, last = band * BAND_ROWS, min(rows, (band + 1) * BAND_ROWS)
        for k in range(len(spots)):
            x, y, height = spots[k, 0], spots[k, 1], spots[k, 3]
            per_r2 = 1.0 / (spots[k, 2] * spots[k, 2])
            for j in range(max(first, boxes[k, 2]), min(last, boxes[k, 3])):
                for i in range(boxes[k, 0], boxes[k, 1]):
                    dx, dy = material_x[j, i] - x, material_y[j, i] - y
                    bare[j, i] *= 1.0 - height * _fade((dx * dx + dy * dy) * per_r2)
    return bare


@njit(cache=True, parallel=True, error_model="numpy")
def paint_gradient(rows, columns, spots, boxes):
    """Derivatives by column and row ``(2, H, W)`` of the bare share of the reference image, by the product rule."""
    bare = np.ones((rows, columns))
    slope = np.zeros((2, rows, columns))
    for band in prange((rows + BAND_ROWS - 1) // BAND_ROWS):
        first, last = band * BAND_ROWS, min(rows, (band + 1) * BAND_ROWS)
        for k in range(len(spots)):
            x, y, height = spots[k, 0], spots[k, 1], spots[k, 3]
            per_r2 = 1.0 / (spots[k, 2] * spots[k, 2])
            for j in range(max(first, boxes[k, 2]), min(last, boxes[k, 3])):
                for i in range(boxes[k, 0], boxes[k, 1]):
                    dx, dy = i - x, j - y
                    spot = height * _fade((dx * dx + dy * dy) * per_r2)
                    left, rise = 1.0 - spot, 2.0 * per_r2 * spot * bare[j, i]
                    slope[0, j, i] = slope[0, j, i] * left + rise * dx
                    slope[1, j, i] = slope[1, j, i] * left + rise * dy
                    bare[j, i] *= left
    return slope
