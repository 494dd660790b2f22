"""B-spline interpolation as it is defined: coefficients from the linear system, values as the sum over all B-splines.

Unser, Aldroubi, Eden 1993 (IEEE Trans Signal Process 41:821-833). Beyond its border an image goes on as its point
reflection in the border pixels, ``f(-x) = 2 f(0) - f(x)``, and so do its coefficients.
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
    """The spline at columns and rows ``(N,)`` on the image."""
    return _summed(coefficients, order, x, y, bspline, bspline)


def slopes(coefficients: FloatArray, order: int, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Its derivatives by column and by row ``(N,)``."""
    return (
        _summed(coefficients, order, x, y, bspline_slope, bspline),
        _summed(coefficients, order, x, y, bspline, bspline_slope),
    )


def _positive(x: FloatArray) -> FloatArray:
    return np.maximum(x, 0.0)


def _at_pixels(size: int, order: int) -> FloatArray:
    """The matrix that takes coefficients ``(size,)`` to values at the pixels."""
    reach = order // 2
    extended = np.pad(np.eye(size), ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    weights = bspline(order, np.arange(-reach, reach + 1.0))
    return sum(weight * extended[k : k + size] for k, weight in enumerate(weights))


def _summed(coefficients, order, x, y, along, down) -> FloatArray:
    room = order // 2 + 2
    extended = np.pad(coefficients, room, mode="reflect", reflect_type="odd")
    x, y = np.asarray(x, float).ravel(), np.asarray(y, float).ravel()
    reach = np.arange(-(order // 2) - 1, order // 2 + 2)
    columns = np.floor(x).astype(int)[:, None] + reach
    rows = np.floor(y).astype(int)[:, None] + reach
    near = extended[(rows + room)[:, :, None], (columns + room)[:, None, :]]
    return np.einsum("nij,ni,nj->n", near, down(order, y[:, None] - rows), along(order, x[:, None] - columns))
