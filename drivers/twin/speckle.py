"""A speckle pattern that is defined once on the material: a uniform bicubic B-spline of random coefficients."""

from __future__ import annotations

import numpy as np
from numba import njit

from drivers.twin.optics import FloatArray
from drivers.twin.options import SpeckleOptions

#: The pattern repeats after this many spacings. A power of two, for the kernel's masking.
PERIOD = 512


def speckle_coefficients(speckle: SpeckleOptions) -> FloatArray:
    """The pattern's coefficients ``(PERIOD + 3, PERIOD + 3)``: ground or paint, at random; the last 3 repeat the first.

    The B-spline's weights are positive and add up to one, so the pattern stays between ``dark`` and ``bright``; it
    is twice continuously differentiable. Its autocorrelation is 1.9 spacings wide at half height.
    """
    paint = np.random.default_rng(speckle.seed).random((PERIOD, PERIOD)) < 0.5
    return np.pad(np.where(paint, speckle.dark, speckle.bright), (0, 3), mode="wrap")


@njit(cache=True, inline="always")
def _weights(t):
    """The four cubic B-spline weights at a fraction t of a spacing."""
    s = 1.0 - t
    return (
        s * s * s / 6.0,
        2.0 / 3.0 - t * t * (2.0 - t) / 2.0,
        2.0 / 3.0 - s * s * (2.0 - s) / 2.0,
        t * t * t / 6.0,
    )


@njit(cache=True, error_model="numpy")
def speckle_at(u, v, coefficients, spacing):
    """Reflectance at a material point (mm)."""
    x, y = u / spacing, v / spacing
    i, j = np.floor(x), np.floor(y)
    wx, wy = _weights(x - i), _weights(y - j)
    column, row = int(i) & (PERIOD - 1), int(j) & (PERIOD - 1)
    total = 0.0
    for b in range(4):
        line = coefficients[row + b]
        total += wy[b] * (
            wx[0] * line[column] + wx[1] * line[column + 1] + wx[2] * line[column + 2] + wx[3] * line[column + 3]
        )
    return total
