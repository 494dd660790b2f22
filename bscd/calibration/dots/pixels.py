"""Grey values as the dot finder wants them: checked, their full scale, noise, and an 8-bit copy for the search."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import FloatArray
from bscd.calibration.dots.findings import Image
from bscd.errors import InputError

_BIT_DEPTHS = (8, 10, 12, 14, 16)


def checked(image: Image) -> Image:
    """The image as a contiguous array the kernels take: uint8, uint16 or float32 (``InputError`` otherwise)."""
    image = np.asarray(image)
    if image.ndim != 2:
        raise InputError(f"image: has shape {image.shape}, a monochrome image (rows, columns) is needed")
    if min(image.shape) < 16:
        raise InputError(f"image: is only {image.shape[1]} x {image.shape[0]} pixels")
    if image.dtype in (np.uint8, np.uint16):
        return np.ascontiguousarray(image)
    if not np.issubdtype(image.dtype, np.floating):
        raise InputError(f"image: has type {image.dtype}; give uint8, uint16 or float")
    if not np.isfinite(image).all():
        raise InputError("image: has grey values that are not finite")
    return np.ascontiguousarray(image, np.float32)


def full_scale(image: Image) -> float:
    """The grey value at which this image saturates: of its type, or the next bit depth above its maximum."""
    if image.dtype == np.uint8:
        return 255.0
    top = float(image.max())
    if image.dtype != np.uint16 and top <= 1.0:
        return 1.0
    return float(next((2**bits - 1 for bits in _BIT_DEPTHS if top <= 2**bits - 1), 2**16 - 1))


def noise_level(image: Image) -> float:
    """Standard deviation of the pixel noise, from the median of a mask blind to planes (Immerkaer 1996)."""
    grey = image[::2].astype(np.float32) if image.shape[0] > 64 else image.astype(np.float32)
    twice = grey[:, 2:] - 2.0 * grey[:, 1:-1] + grey[:, :-2]
    return float(np.median(np.abs(twice[::2, ::2])) / (0.6745 * np.sqrt(6.0)))


def eight_bits(image: Image) -> tuple[NDArray[np.uint8], float]:
    """An 8-bit copy stretched over the used range, for the search only, and its grey levels per original one."""
    if image.dtype == np.uint8:
        return np.asarray(image, np.uint8), 1.0
    sample = image[::4, ::4]
    low, high = (float(v) for v in np.percentile(sample, (0.1, 99.9)))
    gain = 255.0 / max(high - low, 1e-12)
    grey = np.clip((image.astype(np.float32) - np.float32(low)) * np.float32(gain), 0, 255)
    return grey.astype(np.uint8), gain


def grey_at(image: Image, xy_px: FloatArray) -> FloatArray:
    """Grey values ``(...)`` at the pixels nearest to positions ``(..., 2)``; NaN off the image."""
    column, row = np.rint(xy_px[..., 0]), np.rint(xy_px[..., 1])
    height, width = image.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    value = image[np.where(inside, row, 0).astype(int), np.where(inside, column, 0).astype(int)]
    return np.where(inside, value.astype(np.float64), np.nan)
