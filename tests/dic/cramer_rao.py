"""The least standard deviation that any unbiased affine ZNSSD match can have: the Cramer-Rao limit.

Model of one subset, pixels i at offsets (dx, dy) from its centre: the reference shows ``f_i = s_i + n_i`` and the
current image, resampled at the subset's true place, ``g_i = a s(x_i + w_i(p)) + b + m_i``, with white Gaussian noise n
and m of standard deviations sigma_f and sigma_g. Unknown are the affine parameters p = (u, u_x, u_y, v, v_x, v_y),
the gain a, the offset b and the pattern s itself. Given the others, the best s_i is the weighted mean of what both
images say, and what is left of the likelihood is that of the differences ``g_i - a f_i - b``, of variance
``sigma_g^2 + a^2 sigma_f^2``. At a = 1, b = 0, p = 0 their derivatives by (p, a, b) are

    J_i = (s_x, s_x dx, s_x dy, s_y, s_y dx, s_y dy, s_i, 1)

so the information is ``F = sum_i J_i J_i^T / (sigma_f^2 + sigma_g^2)`` and the limits of u and v are the roots of the
first and fourth diagonal elements of its inverse. Translation alone gives the better known
``2 sigma^2 / sum s_x^2`` (the SSSIG of Pan et al., Optics Express 16, 7037, 2008).
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tests.dic.motions import FloatArray

_POINTS_AT_ONCE = 1000


def cramer_rao_px(
    image: FloatArray,
    gradient: FloatArray,
    points_px: NDArray[np.int64],
    noise_grey: tuple[float, float],
    subset_px: int = 21,
) -> FloatArray:
    """Limits ``(N, 2)`` px of the standard deviations of u and v at ``points_px (N, 2)``, whole pixels.

    ``image (H, W)`` and ``gradient (2, H, W)`` by column and row are those of the reference without noise;
    ``noise_grey`` are the standard deviations in the reference and in the current image.
    """
    half = subset_px // 2
    windows = [sliding_window_view(a, (subset_px, subset_px)) for a in (image, *gradient)]
    dy, dx = (offset.ravel() for offset in np.mgrid[-half : half + 1, -half : half + 1].astype(np.float64))
    limits = np.empty((len(points_px), 2))
    for first in range(0, len(points_px), _POINTS_AT_ONCE):
        some = slice(first, first + _POINTS_AT_ONCE)
        columns, rows = points_px[some].T - half
        s, s_x, s_y = (w[rows, columns].reshape(len(rows), -1) for w in windows)
        # without its mean, which is a change of b by a: the same limits, better conditioned
        level = s - s.mean(axis=1, keepdims=True)
        shape = [s_x, s_x * dx, s_x * dy, s_y, s_y * dx, s_y * dy]
        sensitivity = np.stack([*shape, level, np.ones_like(s)], axis=1)
        covariance = np.linalg.inv(sensitivity @ sensitivity.transpose(0, 2, 1))
        limits[some] = np.sqrt(covariance[:, (0, 3), (0, 3)])
    return limits * np.hypot(*noise_grey)
