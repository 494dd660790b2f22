"""How large speckles are: the width of the autocorrelation's peak in windows of an image."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.dic.noise import Image, checked_image, checked_mask
from bscd.errors import InputError

LEAST_WINDOW_PX = 8

_WINDOWS_AT_ONCE = 256
_TEXTURE = 0.3  # of the noise's variance, by which the window's must exceed it


def speckle_size(
    image: Image,
    points_px: FloatArray,
    *,
    window_px: int = 64,
    noise_grey: float = 0.0,
    mask: BoolArray | None = None,
) -> FloatArray:
    """Width and height ``(N, 2)`` px of the speckles round points: of the autocorrelation's peak at half its height.

    The peak is that of the grey levels less the window's mean, normalised by the pixel pairs at each lag; noise,
    which is on its top only, is taken off. For spots ``exp(-r^2 / R^2)`` the width is 2.35 R. Between lags the
    logarithm goes linearly with the lag's square, as it does for such spots.

    Parameters
    ----------
    image
        ``(H, W)``, any integer or float type.
    points_px
        ``(N, 2)`` (column, row).
    window_px
        Edge of the window about each point, at least 8; it is moved into the image where it would reach out.
    noise_grey
        Standard deviation of the noise.
    mask
        ``(H, W)``, True where pixels may be used.

    Returns
    -------
    NaN off the image, on masked pixels and in windows without texture above the noise; infinite where half the
    height is not reached within half a window.

    Raises
    ------
    InputError
        For an image, mask, points, window or noise that can not be used.
    """
    image = checked_image(image)
    used = checked_mask(mask, image.shape)
    if not LEAST_WINDOW_PX <= window_px <= min(image.shape):
        raise InputError(f"window_px: is {window_px}; {LEAST_WINDOW_PX} to {min(image.shape)} px fit this image")
    if not (np.isfinite(noise_grey) and noise_grey >= 0.0):
        raise InputError(f"noise_grey: is {noise_grey}, a standard deviation of 0 grey levels or more is needed")
    centre, inside = nearest_pixels(points_px, image.shape, used)
    size = np.full((len(centre), 2), np.nan)
    where = np.flatnonzero(inside)
    for first in range(0, len(where), _WINDOWS_AT_ONCE):
        some = where[first : first + _WINDOWS_AT_ONCE]
        size[some] = _sizes(image, used, centre[some], int(window_px), noise_grey**2)
    return size


def nearest_pixels(points_px: FloatArray, shape: tuple[int, ...], mask: BoolArray | None) -> tuple[IntArray, BoolArray]:
    """The pixels ``(N, 2)`` nearest to points ``(N, 2)``, and which ``(N,)`` of them are on the image and the mask."""
    points = np.asarray(points_px)
    if points.ndim != 2 or points.shape[1] != 2 or points.dtype.kind not in "uif":
        raise InputError(f"points_px: has shape {points.shape} of {points.dtype}, real numbers (N, 2) are needed")
    nearest = np.rint(points.astype(np.float64))
    limit = np.array([shape[1], shape[0]])
    inside = np.asarray(((nearest >= 0) & (nearest < limit)).all(axis=1), bool)
    centre = np.where(inside[:, None], nearest, 0.0).astype(np.int64)
    if mask is not None:
        inside &= mask[centre[:, 1], centre[:, 0]]
    return centre, inside


def _sizes(image: Image, used: BoolArray | None, centre: IntArray, window: int, noise_grey2: float) -> FloatArray:
    """Width and height ``(n, 2)`` of the autocorrelation in windows about pixels ``(n, 2)``."""
    column, row = np.clip(centre - window // 2, 0, [image.shape[1] - window, image.shape[0] - window]).T
    shape = (window, window)
    grey = sliding_window_view(image, shape)[row, column].astype(np.float32)
    weight = np.ones((1, *shape), np.float32)
    if used is not None:
        weight = sliding_window_view(used, shape)[row, column].astype(np.float32)
    grey -= ((grey * weight).sum(axis=(1, 2)) / weight.sum(axis=(1, 2)))[:, None, None]
    grey *= weight
    return np.stack([_width(_lagged(grey, axis), _lagged(weight, axis), noise_grey2) for axis in (2, 1)], axis=-1)


def _lagged(field: NDArray[np.float32], axis: int) -> FloatArray:
    """Sums ``(n, window // 2 + 1)`` of the products of pixels at each lag along an axis of ``(n, window, window)``."""
    window = field.shape[axis]
    length = window + window // 2  # no lag that is looked at wraps round
    power = np.abs(np.fft.rfft(field, length, axis=axis)) ** 2
    return np.fft.irfft(power.sum(axis=3 - axis), length, axis=1)[:, : window // 2 + 1]


def _width(products: FloatArray, pairs: FloatArray, noise_grey2: float) -> FloatArray:
    """Twice the lag ``(n,)`` at which the covariance falls to half of what it is at lag 0 without the noise."""
    covariance = products / np.maximum(pairs, 0.5)
    top = covariance[:, 0] - noise_grey2
    textured = top > np.maximum(_TEXTURE * noise_grey2, np.finfo(np.float32).eps * covariance[:, 0].max(initial=1.0))
    height = np.where(pairs < 0.5, 1.0, covariance / np.where(textured, top, 1.0)[:, None])
    height[:, 0] = 1.0
    lag = np.argmax(height < 0.5, axis=1)
    reached = lag > 0
    before, after = (height[np.arange(len(lag)), np.maximum(lag - back, 0)] for back in (1, 0))
    before, after = np.where(reached, before, 1.0), np.where(reached, after, 0.25)
    positive = after > 0.0
    fall = np.log(2.0 * before) / np.log(before / np.where(positive, after, 0.25 * before))
    straight = lag - 1.0 + (before - 0.5) / (before - after)
    half = np.where(positive, np.sqrt((lag - 1.0) ** 2 + fall * np.abs(2.0 * lag - 1.0)), straight)
    return np.where(textured, np.where(reached, 2.0 * half, np.inf), np.nan)
