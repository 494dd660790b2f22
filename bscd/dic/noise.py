"""Noise of an image in grey levels, from the image alone or from a static pair, and how it grows with the level.

From one image: the difference of eighth order across rows and columns (binomial weights) passes what alternates from
pixel to pixel in both directions. White noise is there as everywhere, speckles are not: for soft ones of 5 px less
than 0.01 grey levels of 200 are left. Immerkaer (Computer Vision and Image Understanding 64, 300, 1996) has the same
mask with the second order; the median of the absolute values is that of Donoho and Johnstone (Biometrika 81, 425,
1994), who take it from the finest diagonal wavelets, which pass far more of a speckle pattern.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import comb

import cv2
import numpy as np
from numpy.typing import NDArray

from bscd.arrays import BoolArray, FloatArray
from bscd.errors import InputError

#: A monochrome image ``(H, W)`` of any integer or float type.
Image = NDArray[np.integer | np.floating]

_ORDER = 8
_REACH_PX = _ORDER // 2
_DIFFERENCE = np.array([(-1) ** k * comb(_ORDER, k) for k in range(_ORDER + 1)], np.float32)
_DIFFERENCE /= np.linalg.norm(_DIFFERENCE)
#: The level whose noise is in a difference: pixels count by the squares of their weights, the outer ones with 1 %.
_SHARES = _DIFFERENCE[2:-2] ** 2 / np.sum(_DIFFERENCE[2:-2] ** 2)
_SAMPLES = 40_000  # at least, where the image has as many
_FEWEST = 64
_CLASSES = 32
_MAD = 0.67449  # of a standard deviation: the median of absolute values
_MAD_EFFICIENCY = 0.37
_CLIP_SIGMAS = 4.0
_SIGNIFICANT = 3.0  # standard errors
_BIT_DEPTHS = (8, 10, 12, 14, 16)


@dataclass(frozen=True)
class ImageNoise:
    """Noise of an image.

    ``sigma_grey`` is the standard deviation in grey levels, rounding included, as the rms over the unsaturated
    pixels looked at. The affine model of a sensor's read and photon noise, ``variance = offset_grey2 + slope_grey
    * level``, was fitted to ``variance_grey2`` ``(C,)`` in classes of equally many pixels of mean level
    ``level_grey`` ``(C,)``; its slope is 0 where it is below three standard errors. ``samples`` is how many pixels
    were looked at.
    """

    sigma_grey: float
    offset_grey2: float
    slope_grey: float
    level_grey: FloatArray
    variance_grey2: FloatArray
    samples: int

    def variance_at(self, level_grey: FloatArray | float) -> FloatArray:
        """Variance (grey levels squared) of the model at these levels, same shape; 0 where the line is below 0."""
        return np.maximum(self.offset_grey2 + self.slope_grey * np.asarray(level_grey, np.float64), 0.0)


def estimate_noise(image: Image, *, mask: BoolArray | None = None) -> ImageNoise:
    """Noise from a single image; within 5 % for white noise and soft speckles of 5 px and more.

    Finer or sharper speckles reach the highest frequencies: classes of levels where they add variance to the line
    through the others are trusted less, but from speckles below about 4 px wide the result is too large (by a fifth
    of 0.5 grey levels at 3.6 px). Noise that is correlated from pixel to pixel (demosaiced, compressed images) is
    underestimated. `noise_from_pair` has neither fault.

    Parameters
    ----------
    image
        ``(H, W)``, any integer or float type. Saturated pixels and those up to 4 px from them are left out.
    mask
        ``(H, W)``, True where the image is to be looked at; everywhere by default.

    Raises
    ------
    InputError
        For an image or mask that can not be used, or one with too few unsaturated pixels.
    """
    image = checked_image(image)
    usable = _usable([image], checked_mask(mask, image.shape))
    detail = cv2.sepFilter2D(image, cv2.CV_32F, _DIFFERENCE, _DIFFERENCE)
    level = cv2.sepFilter2D(image, cv2.CV_32F, _SHARES, _SHARES)
    levels, noise = _sampled(usable, level, detail)
    return _described(levels, noise, _median_variance, _MAD_EFFICIENCY, one_sided=True)


def noise_from_pair(first: Image, second: Image, *, mask: BoolArray | None = None) -> ImageNoise:
    """Noise of either of two images of a scene at rest; within 3 %, whatever the speckles and the noise's correlation.

    A gain and an offset between the two (light, exposure) are removed; motion, even of 0.01 px, counts as noise.

    Parameters
    ----------
    first, second
        ``(H, W)``, any integer or float type. Pixels saturated in either and those up to 4 px from them are left out.
    mask
        ``(H, W)``, True where the images are to be looked at; everywhere by default.

    Raises
    ------
    InputError
        For images or a mask that can not be used, images of different sizes or with too few unsaturated pixels.
    """
    first, second = checked_image(first, "first image"), checked_image(second, "second image")
    if first.shape != second.shape:
        raise InputError(f"pair: the images have different sizes, {first.shape} and {second.shape} (rows, columns)")
    usable = _usable([first, second], checked_mask(mask, first.shape))
    size = (2 * _REACH_PX + 1,) * 2
    means = [cv2.boxFilter(image, cv2.CV_32F, size) for image in (first, second)]
    one, other = _sampled(usable, *means)
    gain, offset = _gain_and_offset(one, other)
    one, other = (values.astype(np.float64) for values in _sampled(usable, first, second))
    both = 1.0 + gain**2
    difference = (other - gain * one - offset) / np.sqrt(both)
    # the level whose noise is in the difference, as for a single image
    level = (gain**2 * one + other) / both
    whole = not (np.issubdtype(first.dtype, np.floating) or np.issubdtype(second.dtype, np.floating))
    step = float(1.0 / np.sqrt(both)) if whole else 0.0
    return _described(level, difference, lambda classes: _clipped_variance(classes, step), 1.0, one_sided=False)


def checked_image(image: Image, name: str = "image") -> Image:
    """The image as a contiguous array that OpenCV takes: uint8, uint16 or float32.

    Raises `InputError` for anything that is not a monochrome image of finite grey levels.
    """
    grey = np.asarray(image)
    if grey.ndim != 2 or grey.size == 0:
        raise InputError(f"{name}: has shape {grey.shape}, a monochrome image (rows, columns) is needed")
    if grey.dtype.kind not in "uif":
        raise InputError(f"{name}: pixels of type {grey.dtype} are no grey levels; give integers or floats")
    if grey.dtype in (np.uint8, np.uint16):
        return np.ascontiguousarray(grey)
    with np.errstate(over="ignore"):
        values = np.ascontiguousarray(grey, np.float32)
    if not np.isfinite(values).all():
        raise InputError(f"{name}: {np.count_nonzero(~np.isfinite(values))} pixels are not finite; fill and mask them")
    return values


def checked_mask(mask: BoolArray | None, shape: tuple[int, ...], name: str = "mask") -> BoolArray | None:
    """The mask ``(H, W)`` as booleans, None if everything counts; `InputError` unless it is one for this image."""
    if mask is None:
        return None
    used = np.asarray(mask)
    if used.shape != shape:
        raise InputError(f"{name}: its shape is {used.shape}, the image's {shape}; give one value a pixel")
    if used.dtype.kind not in "bui":
        raise InputError(f"{name}: holds True where pixels count, not values of type {used.dtype}")
    whole = np.ascontiguousarray(used != 0)
    return None if whole.all() else whole


def saturated(image: Image) -> BoolArray | None:
    """Pixels ``(H, W)`` at 0 or at full scale (of 8, 10, 12, 14 or 16 bits, or 1.0), None if there are none.

    Floats with values below 0 have no black level; values above 16 bits, no full scale.
    """
    low, high, _, _ = cv2.minMaxLoc(image)
    scales = [2.0**bits - 1.0 for bits in _BIT_DEPTHS if bits == 8 or image.dtype != np.uint8]
    if image.dtype not in (np.uint8, np.uint16) and high <= 1.0:
        scales = [1.0]
    clipped = [image == value for value, met in ((low, low == 0.0), (high, high in scales)) if met]
    if not clipped:
        return None
    return clipped[0] | clipped[1] if len(clipped) == 2 else clipped[0]


def _usable(images: list[Image], mask: BoolArray | None) -> NDArray[np.uint8]:
    """Pixels ``(H, W)``, 1 or 0, whose neighbourhood is inside the image and the mask and nowhere saturated."""
    height, width = images[0].shape
    usable = np.zeros((height, width), np.uint8)
    bad = None if mask is None else ~mask
    for image in images:
        clipped = saturated(image)
        if clipped is not None:
            bad = clipped if bad is None else bad | clipped
    inside = slice(_REACH_PX, height - _REACH_PX), slice(_REACH_PX, width - _REACH_PX)
    if bad is None:
        usable[inside] = 1
    else:
        spread = cv2.dilate(bad.view(np.uint8), np.ones((2 * _REACH_PX + 1,) * 2, np.uint8))
        usable[inside] = spread[inside] == 0
    if cv2.countNonZero(usable) < _FEWEST:
        raise InputError(
            f"image: fewer than {_FEWEST} pixels are {_REACH_PX} px inside the mask and away from pixels at 0 or full "
            "scale; widen the mask or change the exposure"
        )
    return usable


def _sampled(usable: NDArray[np.uint8], *images: NDArray) -> list[NDArray]:
    """The usable pixels ``(n,)`` of each image, on a grid that leaves about as many as are needed."""
    stride = max(1, int(np.sqrt(cv2.countNonZero(usable) / _SAMPLES)))
    grid = slice(_REACH_PX, -_REACH_PX, stride), slice(_REACH_PX, -_REACH_PX, stride)
    chosen = usable[grid].view(np.bool_)
    if chosen.all():
        return [image[grid].ravel() for image in images]
    if np.count_nonzero(chosen) < _FEWEST:
        chosen, grid = usable.view(np.bool_), (slice(None), slice(None))
    return [image[grid][chosen] for image in images]


def _described(
    level: FloatArray,
    noise: FloatArray,
    variance_of: Callable[[FloatArray], FloatArray],
    efficiency: float,
    *,
    one_sided: bool,
) -> ImageNoise:
    """From samples ``(n,)`` of the noise alone and of the level that each belongs to.

    ``efficiency`` is that of ``variance_of`` against a mean of squares.
    """
    classes = int(np.clip(len(level) // _FEWEST, 1, _CLASSES))
    each = len(level) // classes
    span = float(level.max() - level.min())
    # sorting small integers is several times faster
    key = ((level - level.min()) * (65535.0 / span if span > 0.0 else 0.0)).astype(np.uint16)
    order = np.argsort(key, kind="stable")[: each * classes]
    levels = level[order].reshape(classes, each).mean(axis=1, dtype=np.float64)
    variances = variance_of(np.abs(noise[order]).reshape(classes, each))
    offset, slope = _affine(levels, variances, float(np.sqrt(2.0 / (efficiency * each))), one_sided)
    sigma = np.sqrt(max(offset + slope * levels.mean(), 0.0))
    return ImageNoise(float(sigma), offset, slope, levels, variances, len(level))


def _median_variance(absolute: FloatArray) -> FloatArray:
    """Variance in each row ``(C, n)`` of absolute values, from their median."""
    middle = absolute.shape[1] // 2
    return (np.partition(absolute, middle, axis=1)[:, middle].astype(np.float64) / _MAD) ** 2


def _clipped_variance(absolute: FloatArray, step: float) -> FloatArray:
    """Variance in each row ``(C, n)``, without values beyond 4 sigma.

    A median would jump between the few values that the difference of two integer images has; for their sake the
    clipping is wider by one ``step`` of theirs.
    """
    square = absolute.astype(np.float64) ** 2
    sigma = np.quantile(absolute, 0.9, axis=1) / 1.645
    for _ in range(8):
        kept = absolute <= (_CLIP_SIGMAS * sigma + step)[:, None]
        sigma = np.sqrt((square * kept).sum(axis=1) / np.maximum(kept.sum(axis=1), 1))
    return sigma**2


def _affine(level: FloatArray, variance: FloatArray, relative: float, one_sided: bool) -> tuple[float, float]:
    """Offset and slope of ``variance (C,)`` over ``level (C,)``, each known to ``relative`` times itself.

    ``one_sided``: texture may have added to some; classes far above the line lose weight (Huber's first, then
    Cauchy's), those below do not.
    """
    floor = max(1e-3 * float(variance.max()), float(np.finfo(np.float32).tiny))
    line = np.full_like(variance, np.median(variance))
    slope = middle = height = 0.0
    for turn in range(12 if one_sided else 4):
        sigma = relative * np.maximum(line, floor)
        weight = sigma**-2.0
        if one_sided:
            above = np.maximum((variance - line) / sigma, 1e-9)
            weight *= np.minimum(1.0, 1.5 / above) if turn < 8 else 1.0 / (1.0 + (above / 3.0) ** 2)
        total = weight.sum()
        middle, height = float(weight @ level / total), float(weight @ variance / total)
        spread = float(weight @ (level - middle) ** 2)
        slope = float(weight @ ((level - middle) * (variance - height)) / spread) if spread > 0.0 else 0.0
        line = height + slope * (level - middle)
        scatter = float(weight @ (variance - line) ** 2) / max(len(level) - 2, 1)
        if slope**2 * spread < _SIGNIFICANT**2 * max(scatter, 1.0):
            slope, line = 0.0, np.full_like(variance, height)
    return height - slope * middle, slope


def _gain_and_offset(first: FloatArray, second: FloatArray) -> tuple[float, float]:
    """Gain and offset of the line from ``first (n,)`` to ``second (n,)``; what does not fit is left out."""
    one, other = first.astype(np.float64), second.astype(np.float64)
    kept = np.ones(len(one), bool)
    gain, offset = 1.0, 0.0
    for _ in range(5):
        centre, target = one[kept].mean(), other[kept].mean()
        spread = ((one[kept] - centre) ** 2).sum()
        gain = float(((one[kept] - centre) * (other[kept] - target)).sum() / spread) if spread > 0.0 else 1.0
        offset = float(target - gain * centre)
        miss = np.abs(other - gain * one - offset)
        kept = miss <= _CLIP_SIGMAS / _MAD * np.median(miss)
    return gain, offset
