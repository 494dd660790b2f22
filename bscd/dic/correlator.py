"""Correlate two images: initial guesses, the cheapest that works first, then IC-GN at every point."""

from __future__ import annotations

import math

import numpy as np

from bscd.arrays import BoolArray, FloatArray
from bscd.dic.correlation import Correlation, Status
from bscd.dic.images import PreparedImage, prepare
from bscd.dic.matching import Matching
from bscd.dic.noise import Image, estimate_noise
from bscd.dic.solver import LIGHTINGS, PARAMETERS, KnownSubsets, Lighting, ShapeName, SolverOptions, with_noise
from bscd.dic.spline import SplineName
from bscd.errors import InputError


def correlate(
    reference: Image | PreparedImage,
    current: Image | PreparedImage,
    points_px: FloatArray,
    *,
    subset_px: int = 21,
    guess_px: FloatArray | None = None,
    find_guesses: bool = True,
    shape: ShapeName = "affine",
    lighting: Lighting = "uniform",
    interpolation: SplineName = "quintic",
    reference_mask: BoolArray | None = None,
    current_mask: BoolArray | None = None,
    noise_grey: float | tuple[float, float] | None = None,
    search_px: int = 41,
    zncc_min: float = 0.7,
    tolerance_px: float = 0.001,
    max_iterations: int = 30,
    threads: int | None = None,
    known_subsets: KnownSubsets | None = None,
) -> Correlation:
    """Find where points of a reference image are in a current image.

    IC-GN with the ZNSSD criterion (Pan, Li, Tong 2013, Exp Mech 53:1277-1289; second order: Gao et al. 2015, Opt
    Lasers Eng 65:73-80) on a B-spline. The result does not depend on the number of threads.

    Parameters
    ----------
    reference, current
        ``(H, W)``, integers or floats, of one size and type; or `prepare`d, with their masks, interpolation and subset.
    points_px
        ``(N, 2)`` (column, row) in the reference, whole or fractional pixels.
    subset_px
        Edge of the square subset, odd. Near borders and masks the valid part of it is used.
    guess_px
        Displacements ``(N, 2)`` or shape parameters ``(N, 6)`` / ``(N, 12)`` to start from, NaN where not known.
        Without it, and where it fails: neighbours, dense flow, features and search, in this order of cost.
    find_guesses
        False: nothing but the given guesses and what propagates from them.
    shape
        "affine" (6 parameters), "quadratic" (12, for steep gradients; about twice the noise), "curved" (affine on the
        second derivatives of a given guess ``(N, 12)``, which are held: steep gradients with the noise of "affine";
        `Curvature` takes them from a field) or "translation" (2, for gradients below about 0.01; a tenth less noise;
        gradients of a given guess ``(N, 6)`` are held).
    lighting
        "uniform": ZNSSD's own gain and offset. "linear": the gain may change linearly across the subset too, as when a
        surface turns under its lamps: shading that would pull a match along with it is taken out, for some per cent
        more noise. It takes grey level 0 for black.
    reference_mask, current_mask
        ``(H, W)``, True where pixels may be used.
    noise_grey
        Standard deviation of the noise in grey levels of both images or of (reference, current); estimated from the
        images by default. Sigma rests on it, or on the match's residual where that is larger.
    search_px
        Window of the search, centred on the best guess (the last resort).
    zncc_min
        Matches below it are refused.
    tolerance_px
        A point has converged when the last step moved the edge of its subset by less.
    threads
        None: all cores that the process may use.
    known_subsets
        Of these points in this reference with the same settings: what earlier calls found of their subsets is not found
        again, and what this one finds is kept there. Results are the same.

    Raises
    ------
    InputError
        For images, masks, points or settings that can not be used. Points that can not be matched are no error: their
        `Status` says why.
    """
    points = _checked_points(points_px)
    _check_settings(subset_px, search_px, zncc_min, tolerance_px, max_iterations, threads, shape, lighting)
    first = _prepared(reference, reference_mask, interpolation, subset_px, "reference image")
    second = _prepared(current, current_mask, interpolation, subset_px, "current image")
    if first.shape != second.shape or first.grey.dtype != second.grey.dtype:
        raise InputError(
            f"images: the reference is {first.shape[1]} x {first.shape[0]} px of {first.grey.dtype}, the current image "
            f"{second.shape[1]} x {second.shape[0]} px of {second.grey.dtype}; give two of one size and type"
        )
    if first.spline != second.spline:
        raise InputError(f"images: one is prepared for {first.spline}, one for {second.spline} interpolation")
    noise = _noise(noise_grey, first, second)
    options = SolverOptions(
        subset_px=subset_px,
        shape=shape,
        lighting=lighting,
        max_iterations=max_iterations,
        tolerance_px=tolerance_px,
        reach_px=max(8.0, subset_px / 2.0),
        zncc_min=zncc_min,
    )
    matching = Matching(first, second, points, with_noise(options, *noise), search_px, threads, known_subsets)
    matching.run(_checked_guess(guess_px, len(points), shape), find_guesses)
    return _described(matching, noise)


def _described(matching: Matching, noise: tuple[float, float]) -> Correlation:
    """The result, NaN where points are not valid."""
    solved = matching.solved
    valid = solved.valid
    half = solved.shape.shape[1] // 2
    shape = np.where(valid[:, None], solved.shape, np.nan)
    gain = solved.column("gain")
    # 1 - ZNCC, which it rests on, may round to below 0 where the images are the same
    residual = np.maximum(solved.column("residual_variance"), 0.0)
    variance = np.maximum(noise[0] ** 2 + (noise[1] / gain) ** 2, residual)
    covariance = np.empty((len(shape), 2, 2))
    covariance[:, 0, 0] = solved.column("var_u")
    covariance[:, 0, 1] = covariance[:, 1, 0] = solved.column("cov_uv")
    covariance[:, 1, 1] = solved.column("var_v")
    covariance *= np.where(valid, variance, np.nan)[:, None, None]
    gradient = shape[:, [1, 2, half + 1, half + 2]].reshape(-1, 2, 2)
    # the kernel's are of the step in the reference; the current image is deformed
    onward = np.eye(2) + gradient
    covariance = onward @ covariance @ np.swapaxes(onward, 1, 2)
    refused = solved.status == Status.LOW_ZNCC
    return Correlation(
        displacement_px=shape[:, [0, half]],
        sigma_px=np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)),
        covariance_px2=covariance,
        gradient=gradient,
        shape=shape,
        zncc=np.where(valid | refused, solved.column("zncc"), np.nan),
        residual_grey=np.where(valid, np.sqrt(residual), np.nan),
        pixels=np.nan_to_num(solved.column("pixels")).astype(np.int64),
        iterations=solved.iterations,
        status=solved.status,
        guess=matching.guess,
        noise_grey=noise,
    )


def _prepared(
    image: Image | PreparedImage, mask: BoolArray | None, interpolation: SplineName, subset_px: int, name: str
) -> PreparedImage:
    if not isinstance(image, PreparedImage):
        return prepare(image, mask=mask, interpolation=interpolation, subset_px=subset_px, name=name)
    if mask is not None:
        raise InputError(f"{name}: it is prepared already; give its mask to prepare()")
    if image.subset_px < subset_px:
        raise InputError(f"{name}: prepared for subsets of up to {image.subset_px} px, not {subset_px}")
    return image


def _noise(given: float | tuple[float, float] | None, *images: PreparedImage) -> tuple[float, float]:
    """Noise of both images, grey levels; an image that is too small or too uniform to tell has that of rounding."""
    if given is None:
        first, second = (_estimated(image) for image in images)
    else:
        both = _numbers(given, "noise_grey").ravel()
        first, second = both if both.size == 2 else (*both, *both) if both.size == 1 else (math.nan, math.nan)
    if not all(math.isfinite(value) and value >= 0.0 for value in (first, second)):
        raise InputError(f"noise_grey: {given} is no standard deviation; give one or two, grey levels of 0 or more")
    return float(first), float(second)


def _estimated(image: PreparedImage) -> float:
    rounding = 0.0 if image.grey.dtype.kind == "f" else math.sqrt(1.0 / 12.0)
    try:
        found = estimate_noise(image.grey, mask=None if image.mask is None else image.mask.view(bool))
    except InputError:
        return rounding
    return max(found.sigma_grey, rounding)


def _checked_points(points_px: FloatArray) -> FloatArray:
    points = _numbers(points_px, "points_px")
    if points.size == 0:
        return np.zeros((0, 2))
    if points.ndim != 2 or points.shape[1] != 2:
        raise InputError(f"points_px: the shape (N, 2) is needed, (column, row); not {points.shape}")
    return points


def _numbers(given: object, name: str) -> FloatArray:
    try:
        values = np.asarray(given)
        if values.dtype.kind in "uif" or not values.size:
            return np.ascontiguousarray(values, np.float64)
    except ValueError:
        pass
    raise InputError(f"{name}: holds something that is no real number, or rows of several lengths; give an array")


def _checked_guess(guess_px: FloatArray | None, count: int, shape: ShapeName) -> FloatArray | None:
    """Shape parameters ``(N, P)`` of a guess in any of its forms."""
    if guess_px is None:
        return None
    given = _numbers(guess_px, "guess_px")
    if given.ndim != 2 or given.shape[0] != count or given.shape[1] not in (2, 6, 12):
        raise InputError(f"guess_px: its shape is {given.shape}; ({count}, 2), ({count}, 6) or ({count}, 12) is needed")
    whole = np.zeros((count, PARAMETERS[shape]))
    kept = min(given.shape[1], whole.shape[1]) // 2
    for side in range(2):
        first, source = side * whole.shape[1] // 2, side * given.shape[1] // 2
        whole[:, first : first + kept] = given[:, source : source + kept]
    return whole


def _check_settings(
    subset_px: int,
    search_px: int,
    zncc_min: float,
    tolerance_px: float,
    max_iterations: int,
    threads: int | None,
    shape: str,
    lighting: str,
) -> None:
    if shape not in PARAMETERS:
        raise InputError(f"shape: {shape!r} is no shape function; {', '.join(PARAMETERS)} are known")
    if lighting not in LIGHTINGS:
        raise InputError(f"lighting: {lighting!r} is not known; {' or '.join(LIGHTINGS)}")
    for name, value in (("subset_px", subset_px), ("search_px", search_px)):
        if not isinstance(value, (int, np.integer)) or value < 5 or value % 2 == 0:
            raise InputError(f"{name}: is {value}, an odd number of pixels from 5 is needed")
    if not -1.0 <= zncc_min < 1.0:
        raise InputError(f"zncc_min: is {zncc_min}, a number from -1 to below 1 is needed")
    if not 0.0 < tolerance_px < 1.0:
        raise InputError(f"tolerance_px: is {tolerance_px}, a number above 0 and below 1 is needed")
    if not isinstance(max_iterations, (int, np.integer)) or not 1 <= max_iterations < 2**31:
        raise InputError(f"max_iterations: is {max_iterations}, a whole number from 1 is needed")
    if threads is not None and threads < 1:
        raise InputError(f"threads: is {threads}, at least 1 is needed, or None for all cores")
