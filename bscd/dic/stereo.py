"""Match two views of one surface: seeds by a search along their epipolar curves, the rest from their neighbours."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from bscd.arrays import BoolArray, FloatArray
from bscd.dic.correlation import Correlation
from bscd.dic.correlator import correlate
from bscd.dic.curvature import SECOND, Curvature, follow_curvature, with_scatter
from bscd.dic.guess import seed_points
from bscd.dic.images import PreparedImage
from bscd.dic.solver import Lighting, ShapeName

#: The wider neighbourhood, and what it may say otherwise, in sigma.
_WIDENED = 5 / 3
_DOUBTFUL = 0.5

EpipolarCurve = Callable[[FloatArray], FloatArray]
"""From points ``(n, 2)`` of the left view to where they may be in the right view, ``(n, K, 2)``, by growing depth."""

#: How far beside its epipolar curve a seed is looked for.
_BESIDE_PX = 6

#: A seed's similarity below which its place on the curve is not tried.
_LEAST_SIMILAR = 0.4

#: Distance over which the curve's change from point to point is taken.
_BASELINE_PX = 4.0


def match_views(
    left: PreparedImage,
    right: PreparedImage,
    points_px: FloatArray,
    curve: EpipolarCurve,
    *,
    subset_px: int = 21,
    shape: ShapeName = "curved",
    lighting: Lighting = "linear",
    noise_grey: float | tuple[float, float] | None = None,
    zncc_min: float = 0.7,
    threads: int | None = None,
) -> Correlation:
    """Where points ``(N, 2)`` of the left view are in the right view; no seed by hand, no range by hand.

    One point in each cell of a subset's size is searched for along its epipolar curve by ZNCC; those seeds are matched
    by IC-GN and their neighbours follow from them. "curved" holds the second derivatives that the field itself has.
    """
    seeds = seed_points(points_px, float(subset_px))
    guess = np.full((len(points_px), 6), np.nan)
    guess[seeds] = _search_along(left, right, points_px[seeds], curve, subset_px)
    common: dict[str, Any] = {
        "subset_px": subset_px,
        "lighting": lighting,
        "interpolation": left.spline,
        "noise_grey": noise_grey,
        "zncc_min": zncc_min,
        "threads": threads,
    }
    found = correlate(left, right, points_px, guess_px=guess, find_guesses=False, shape=shape, **common)
    if shape == "curved":
        curvature = Curvature(points_px, subset_px)
        found, second = follow_curvature(left, right, points_px, found, curvature, **common)
        found, smooth = _second_order_where_needed(left, right, points_px, found, second, common)
        found = with_scatter(found, curvature, smooth)
    return found


def _second_order_where_needed(
    left: PreparedImage,
    right: PreparedImage,
    points_px: FloatArray,
    found: Correlation,
    second: FloatArray,
    settings: dict[str, Any],
) -> tuple[Correlation, BoolArray]:
    """Solve for the second derivatives where the field does not tell them well, as at the rim of a sphere.

    There a wider neighbourhood tells others; their effect on the match tells what those of the narrower one are worth.
    Returns the matches and where the field does tell, ``(N,)``.
    """
    wide = Curvature(points_px, settings["subset_px"], widened=_WIDENED)
    with np.errstate(invalid="ignore"):
        off = wide.bias_px(wide.second_derivatives(found.displacement_px) - second) > _DOUBTFUL * found.sigma_px
        smooth = np.asarray(~off.any(axis=1))
    again = np.flatnonzero(found.valid & ~smooth)
    if not len(again):
        return found, smooth
    guess = found.shape[again].copy()
    guess[:, SECOND] = second[again]
    better = correlate(left, right, points_px[again], guess_px=guess, find_guesses=False, shape="quadratic", **settings)
    return found.updated(again, better), smooth


def _search_along(
    left: PreparedImage, right: PreparedImage, points_px: FloatArray, curve: EpipolarCurve, subset_px: int
) -> FloatArray:
    """Affine guesses ``(n, 6)`` at the places of highest ZNCC along the curves; NaN where nothing is similar."""
    guess = np.full((len(points_px), 6), np.nan)
    if not len(points_px):
        return guess
    places = curve(points_px)
    by_column = (curve(points_px + np.array([_BASELINE_PX, 0.0])) - places) / _BASELINE_PX
    by_row = (curve(points_px + np.array([0.0, _BASELINE_PX])) - places) / _BASELINE_PX
    first, second = (np.asarray(image.grey, np.float32) for image in (left, right))
    radius = subset_px // 2
    height, width = left.shape
    for i, (column, row) in enumerate(np.rint(points_px).astype(int)):
        known = np.isfinite(places[i]).all(axis=1)
        if not known.any() or not (radius <= column < width - radius and radius <= row < height - radius):
            continue
        low = np.floor(places[i][known].min(axis=0)).astype(int) - _BESIDE_PX - radius
        high = np.ceil(places[i][known].max(axis=0)).astype(int) + _BESIDE_PX + radius + 1
        x0, y0 = np.maximum(low, 0)
        window = second[y0 : max(high[1], 0), x0 : max(high[0], 0)]
        if min(window.shape) < subset_px:
            continue
        template = first[row - radius : row + radius + 1, column - radius : column + radius + 1]
        score = _near_curve(
            cv2.matchTemplate(window, template, cv2.TM_CCOEFF_NORMED), places[i][known] - (x0 + radius, y0 + radius)
        )
        _, best, _, (x, y) = cv2.minMaxLoc(score)
        if best < _LEAST_SIMILAR:
            continue
        found = np.array([x0 + radius + x, y0 + radius + y], np.float64)
        nearest = np.flatnonzero(known)[np.argmin(np.hypot(*(places[i][known] - found).T))]
        ux, uy = by_column[i, nearest, 0] - 1.0, by_row[i, nearest, 0]
        vx, vy = by_column[i, nearest, 1], by_row[i, nearest, 1] - 1.0
        guess[i] = (found[0] - column, ux, uy, found[1] - row, vx, vy)
    return guess


def _near_curve(score: np.ndarray, places: FloatArray) -> np.ndarray:
    """The scores ``(h, w)`` no farther from the curve ``(K, 2)`` than `_BESIDE_PX`, -1 elsewhere."""
    allowed = np.zeros(score.shape, np.uint8)
    line = np.rint(places).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(allowed, [line], False, 255, 2 * _BESIDE_PX + 1)
    return np.where(allowed > 0, score, np.float32(-1.0))
