"""How well a speckle pattern can be matched, before any matching: gradients, expected sigma, speckle size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.dic.noise import Image, ImageNoise, checked_image, checked_mask, estimate_noise
from bscd.dic.speckle_size import LEAST_WINDOW_PX, nearest_pixels, speckle_size
from bscd.dic.subset_information import SubsetFigures, measure_subsets
from bscd.errors import InputError

_WINDOW_PX = 64
_WINDOWS = 48
_FINE_PX = 3.0
_PER_SUBSET = 3.0
_POOR_SIGMA_PX = 0.02
_SATURATED_SHARE = 0.01


@dataclass(frozen=True)
class SpeckleSummary:
    """The pattern as a whole, over the points on the image and the mask.

    Medians of ``mig_grey``, ``sigma_px`` (of the less sure axis, over subsets with texture) and ``noise_grey``;
    ``untextured_share`` of the points have no finite sigma, ``saturated_share`` is the mean share of saturated
    pixels, ``speckle_px`` the speckles' width and height (`speckle_size`). ``advice`` says in words what limits the
    match. Figures are NaN where there is nothing to take them from.
    """

    mig_grey: float
    sigma_px: float
    noise_grey: float
    untextured_share: float
    saturated_share: float
    speckle_px: tuple[float, float]
    advice: str


@dataclass(frozen=True, eq=False)
class SpeckleQuality:
    """What N subsets of an image promise.

    ``mig_grey`` ``(N,)``: mean intensity gradient, grey levels per px (Pan, Lu, Xie, Optics and Lasers in
    Engineering 48, 469, 2010); noise alone gives 1.36 of its sigma. ``sssig_grey2`` ``(N, 2)``: sums of squares of
    the gradients by column and row (Pan et al., Optics Express 16, 7037, 2008), noise included. ``sigma_px``
    ``(N, 2)``: standard deviation to expect of u and v. ``noise_grey`` ``(N,)``: the noise of one image that it
    rests on. ``saturated_share`` ``(N,)``: of the subset's pixels. ``pixels`` ``(N,)``: how many of the subset are
    inside the image and the mask and were used.

    A point off the image or on a masked pixel is NaN everywhere and has no pixels. A subset that shows no texture
    above the noise along an axis has infinite sigma there.
    """

    mig_grey: FloatArray
    sssig_grey2: FloatArray
    sigma_px: FloatArray
    noise_grey: FloatArray
    saturated_share: FloatArray
    pixels: IntArray
    summary: SpeckleSummary

    @property
    def sigma_translation_px(self) -> FloatArray:
        """Sigma ``(N, 2)`` if only the translation were unknown: ``sqrt(2) noise / sqrt(SSSIG)`` (Pan et al. 2008)."""
        textured = self.sssig_grey2 > 0.0
        root = np.sqrt(np.where(textured, self.sssig_grey2, 1.0))
        sigma = np.where(textured, np.sqrt(2.0) * self.noise_grey[:, None] / root, np.inf)
        return np.where(np.isnan(self.sssig_grey2), np.nan, sigma)


def speckle_quality(
    image: Image,
    points_px: FloatArray,
    *,
    subset_px: int = 21,
    noise_grey: float | ImageNoise | None = None,
    mask: BoolArray | None = None,
) -> SpeckleQuality:
    """Quality of the subsets around points, and of the pattern as a whole.

    The expected sigma is the root of the diagonal of ``2 noise^2 H^-1``, where H is the Hessian of the affine
    parameters, the gain and the offset: the Cramer-Rao limit when both images are noisy. What the noise adds to the
    gradients themselves is taken off H.

    Parameters
    ----------
    image
        ``(H, W)``, any integer or float type.
    points_px
        ``(N, 2)`` (column, row); a subset's centre is the nearest pixel.
    subset_px
        Edge of the subset, odd.
    noise_grey
        Standard deviation of the noise of one image in grey levels, or its description, which is taken at the
        subset's mean level; estimated from the image by default.
    mask
        ``(H, W)``, True where pixels may be used; subsets consist of their usable pixels.

    Raises
    ------
    InputError
        For an image, mask, points, subset size or noise that can not be used.
    """
    image = checked_image(image)
    used = checked_mask(mask, image.shape)
    if not isinstance(subset_px, (int, np.integer)) or subset_px < 3 or subset_px % 2 == 0:
        raise InputError(f"subset_px: is {subset_px}, an odd number of pixels from 3 is needed")
    if subset_px > min(image.shape):
        raise InputError(f"subset_px: {subset_px} does not fit into an image of {image.shape[1]} x {image.shape[0]} px")
    centre, inside = nearest_pixels(points_px, image.shape, used)
    noise = estimate_noise(image, mask=used) if noise_grey is None else noise_grey
    if not isinstance(noise, ImageNoise) and not (np.isfinite(noise) and noise >= 0.0):
        raise InputError(f"noise_grey: is {noise}, a standard deviation of 0 grey levels or more is needed")
    found = measure_subsets(image, used, centre[inside], int(subset_px) // 2, noise)
    size = _typical_size(image, used, centre[inside], int(subset_px), found.noise_grey)

    def among_all(values: FloatArray) -> FloatArray:
        out = np.full((len(inside), *values.shape[1:]), np.nan)
        out[inside] = values
        return out

    return SpeckleQuality(
        mig_grey=among_all(found.mig_grey),
        sssig_grey2=among_all(found.sssig_grey2),
        sigma_px=among_all(found.sigma_px),
        noise_grey=among_all(found.noise_grey),
        saturated_share=among_all(found.saturated_share),
        pixels=np.nan_to_num(among_all(found.pixels)).astype(np.int64),
        summary=_summarised(found, size, int(subset_px)),
    )


def _typical_size(
    image: Image, used: BoolArray | None, centre: IntArray, subset_px: int, noise_grey: FloatArray
) -> tuple[float, float]:
    """Median width and height of the speckles in windows about some of the pixels ``(N, 2)``."""
    window = min(max(_WINDOW_PX, 3 * subset_px), *image.shape)
    if not len(centre) or window < LEAST_WINDOW_PX:
        return np.nan, np.nan
    some = np.unique(np.linspace(0, len(centre) - 1, _WINDOWS).astype(int))
    noise = float(np.sqrt(np.mean(noise_grey[some] ** 2)))
    sizes = speckle_size(image, centre[some].astype(np.float64), window_px=window, noise_grey=noise, mask=used)
    width, height = (_median(size[~np.isnan(size)]) for size in sizes.T)
    return width, height


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if len(values) else np.nan


def _summarised(found: SubsetFigures, size: tuple[float, float], subset_px: int) -> SpeckleSummary:
    """The figures as a whole; the advice names what is beyond its limits, the worst for a match first."""
    sigma = found.sigma_px.max(axis=1, initial=0.0)
    finite = np.isfinite(sigma)
    typical, blank = _median(sigma[finite]), float(np.mean(~finite)) if len(sigma) else np.nan
    clipped = float(found.saturated_share.mean()) if len(sigma) else np.nan
    small, large = min(size), max(size)
    advice = []
    if not len(sigma):
        advice.append("no point is on the image and its mask")
    if blank > 0.0:
        advice.append(f"{blank:.1%} of the subsets show no texture above the noise: mask them, or paint finer speckles")
    if clipped > _SATURATED_SHARE:
        advice.append(f"{clipped:.1%} of the pixels are saturated: less exposure or softer light")
    if typical > _POOR_SIGMA_PX:
        advice.append(f"expected sigma {typical:.3f} px: more contrast, less noise or a larger subset")
    if small < _FINE_PX:
        advice.append(f"speckles are {small:.1f} px wide: below {_FINE_PX:.0f} px interpolation errors grow")
    if large > subset_px / _PER_SUBSET:
        advice.append(
            f"speckles are {large:.1f} px wide: a subset of {subset_px} px holds too few, "
            f"take {_PER_SUBSET:.0f} times their width"
        )
    if not advice:
        advice.append(f"good: speckles {small:.1f} to {large:.1f} px wide, expected sigma {typical:.4f} px")
    return SpeckleSummary(
        _median(found.mig_grey), typical, _median(found.noise_grey), blank, clipped, size, "; ".join(advice)
    )
