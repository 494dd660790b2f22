"""B-spline interpolation as it is defined: coefficients from the linear system, values as the sum over all B-splines.

Unser, Aldroubi, Eden 1993 (IEEE Trans Signal Process 41:821-833). The image counts as mirrored about its border pixels.
"""

from __future__ import annotations

from math import comb, factorial

import numpy as np

from tests.dic.motions import FloatArray

ORDERS = {"cubic": 3, "quintic": 5}


def bspline(order: int, x: FloatArray) -> FloatArray:
    """The centred B-spline: ``sum_k (-1)^k C(n + 1, k) (x + (n + 1) / 2 - k)_+^n / n!``, eq. 2.2."""
    distance = np.abs(np.asarray(x, float))  # it is even; left of its middle fewer terms cancel
    terms = ((-1) ** k * comb(order + 1, k) * _positive((order + 1) / 2 - k - distance) ** order for k in range(order))
    return sum(terms) / factorial(order)


def bspline_slope(order: int, x: FloatArray) -> FloatArray:
    """Its derivative: the difference of two B-splines of the order below."""
    return bspline(order - 1, np.asarray(x) + 0.5) - bspline(order - 1, np.asarray(x) - 0.5)


def coefficients(image: FloatArray, order: int) -> FloatArray:
    """Coefficients ``(H, W)`` of the spline that passes through all pixels of an image ``(H, W)``."""
    down, along = (_at_pixels(size, order) for size in image.shape)
    return np.linalg.solve(along, np.linalg.solve(down, np.asarray(image, float)).T).T


def value(coefficients: FloatArray, order: int, x: FloatArray, y: FloatArray) -> FloatArray:
    """The spline at columns and rows ``(N,)``, which may lie beyond the image."""
    return _summed(coefficients, order, x, y, bspline, bspline)


def slopes(coefficients: FloatArray, order: int, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Its derivatives by column and by row ``(N,)``."""
    return (
        _summed(coefficients, order, x, y, bspline_slope, bspline),
        _summed(coefficients, order, x, y, bspline, bspline_slope),
    )


def _positive(x: FloatArray) -> FloatArray:
    return np.maximum(x, 0.0)


def _mirrored(index: np.ndarray, size: int) -> np.ndarray:
    """The pixel that a place beyond the border shows."""
    period = max(2 * (size - 1), 1)
    index = np.abs(index) % period
    return np.minimum(index, period - index)


def _at_pixels(size: int, order: int) -> FloatArray:
    """The matrix that takes coefficients ``(size,)`` to values at the pixels."""
    matrix = np.zeros((size, size))
    for offset in range(-(order // 2), order // 2 + 1):
        pixels = np.arange(size)
        np.add.at(matrix, (pixels, _mirrored(pixels + offset, size)), bspline(order, np.array(float(offset))))
    return matrix


def _summed(coefficients, order, x, y, along, down) -> FloatArray:
    height, width = coefficients.shape
    x, y = np.asarray(x, float).ravel(), np.asarray(y, float).ravel()
    reach = np.arange(-(order // 2) - 1, order // 2 + 2)
    columns = np.floor(x).astype(int)[:, None] + reach
    rows = np.floor(y).astype(int)[:, None] + reach
    near = coefficients[_mirrored(rows, height)[:, :, None], _mirrored(columns, width)[:, None, :]]
    return np.einsum("nij,ni,nj->n", near, down(order, y[:, None] - rows), along(order, x[:, None] - columns))
