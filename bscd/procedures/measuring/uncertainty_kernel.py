"""The kernels of `Uncertainty`: two views' errors together, and the covariance of both images, point by point."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def _inverse(m, out):
    """Of a ``(2, 2)`` matrix."""
    determinant = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    out[0, 0], out[0, 1] = m[1, 1] / determinant, -m[0, 1] / determinant
    out[1, 0], out[1, 1] = -m[1, 0] / determinant, m[0, 0] / determinant


@njit(cache=True, nogil=True)
def _product(a, b, out):
    for i in range(2):
        for j in range(2):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j]


@njit(cache=True, nogil=True)
def _with_transpose(a, b, out):
    """``a b^T``."""
    for i in range(2):
        for j in range(2):
            out[i, j] = a[i, 0] * b[j, 0] + a[i, 1] * b[j, 1]


@njit(cache=True, nogil=True)
def _carried(a, c, half, out):
    """``a c a^T``."""
    _product(a, c, half)
    _with_transpose(half, a, out)


@njit(cache=True, nogil=True, error_model="numpy")
def both_views(left_gradient, right_gradient, stereo_gradient, left_covariance, right_covariance, across, both):
    """How the left view's place maps to the right one's, ``across`` ``(N, 2, 2)``, and both views' covariances there.

    Gradients and covariances ``(N, 2, 2)``; ``both`` ``(N, 2, 2)`` is their sum in the right view.
    """
    here, there, half = np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2))
    for n in range(len(across)):
        here[:] = left_gradient[n]
        there[:] = stereo_gradient[n]
        for i in range(2):
            here[i, i] += 1.0
            there[i, i] += 1.0
        _inverse(here, half)
        _product(there, half, here)
        there[:] = right_gradient[n]
        there[0, 0] += 1.0
        there[1, 1] += 1.0
        _product(there, here, across[n])
        _carried(across[n], left_covariance[n], half, both[n])
        both[n] += right_covariance[n]


@njit(cache=True, nogil=True)
def half_sum_and_difference(across, moved, other, middle, apart):
    """Of the right view's residuals ``other`` ``(N, 2)`` and the left one's, ``moved``, as the right view sees them."""
    for n in range(len(across)):
        for i in range(2):
            mine = across[n, i, 0] * moved[n, 0] + across[n, i, 1] * moved[n, 1]
            middle[n, i] = (mine + other[n, i]) / 2.0
            apart[n, i] = other[n, i] - mine


@njit(cache=True, nogil=True, error_model="numpy")
def image_covariances(
    across,
    both,
    onward,
    alike,
    apart,
    left_covariance,
    left_reference,
    right_covariance,
    right_reference,
    stereo,
    tracking,
    position,
):
    """Covariances ``(N, 4, 4)`` of (left column, left row, right column, right row).

    ``both``, ``across`` of `both_views`; ``alike``, ``apart`` ``(N,)``: the scatter of the views' half sum and of their
    difference. ``onward`` ``(N, 2, 2)`` carries the stereo match's covariance ``stereo`` on. Into ``tracking`` that of
    the tracking since the reference, into ``position`` that of both places.
    """
    back, each, common = np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2))
    half, shared, same, own = np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2))
    for n in range(len(across)):
        _inverse(across[n], back)
        for i in range(2):
            for j in range(2):
                each[i, j] = both[n, i, j] * (alike[n] + apart[n] - 2.0) / 4.0
                common[i, j] = both[n, i, j] * (alike[n] - apart[n]) / 4.0
        whole = position[n]
        whole[2:, 2:] = each
        _with_transpose(common, back, half)
        whole[2:, :2] = half
        whole[:2, 2:] = half.T
        _carried(back, each, half, own)
        whole[:2, :2] = own + left_covariance[n]
        tracking[n] = whole
        tracking[n, 2:, 2:] += right_covariance[n]
        # the left reference's noise moves both views' places alike
        _product(across[n], left_reference[n], shared)
        whole[2:, :2] += shared
        whole[:2, 2:] += shared.T
        _with_transpose(shared, across[n], same)
        # the right one's moves the stereo match and the tracking from there in opposite ways
        whole[2:, 2:] += same + right_covariance[n] - right_reference[n]
        # of the stereo match so much is what the tracking has too, scatter included; what it has more is its own
        same += right_reference[n]
        _carried(onward[n], stereo[n], half, own)
        _inverse(same, back)
        _product(back, own, half)
        more = (half[0, 0] + half[1, 1]) / 2.0 / apart[n] - 1.0
        if more <= 0.0:
            more = 0.0
        whole[2:, 2:] += more * same
