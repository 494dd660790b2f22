"""The middle of the outline of a patch of points: the circular window's centre where the outline shows one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from bscd.analysis.surface.round_fit import fit_round
from bscd.analysis.surface.spacing import point_spacing
from bscd.arrays import FloatArray, IntArray
from bscd.errors import InputError

_SECTORS = 90
#: A circle is believed when this share of the sectors agrees with it to a point spacing,
_AGREEING = 0.5
#: and the points cover this share of it.
_COVERED = 0.5


@dataclass(frozen=True)
class Outline:
    """The middle ``(2,)`` mm of a patch; ``radius_mm`` and ``sigma_mm`` are NaN where its outline is no circle."""

    middle_mm: FloatArray
    radius_mm: float
    sigma_mm: float

    @property
    def is_circle(self) -> bool:
        """Whether the middle is that of a circle."""
        return bool(np.isfinite(self.radius_mm))


def find_outline(points_mm: FloatArray) -> Outline:
    """The outline of points ``(N, 2)`` mm in a plane.

    The farthest points of 90 sectors are fitted with a circle, robustly, so arcs of a round window count and what a
    hull or a shadow cut off straight does not. Where less than half of the sectors agree within a point spacing, or
    the points cover less than half of the circle, the middle is the centroid of the convex hull.
    """
    hull = ConvexHull(points_mm)
    centroid = _hull_centroid(points_mm[hull.vertices])
    spacing = point_spacing(points_mm)
    first = _circle(points_mm, centroid, spacing, hull.volume)
    if first is None:
        return Outline(centroid, np.nan, np.nan)
    again = _circle(points_mm, first.middle_mm, spacing, hull.volume)  # in sectors about the circle's own middle
    return first if again is None else again


def _circle(points_mm: FloatArray, middle_mm: FloatArray, spacing_mm: float, area_mm2: float) -> Outline | None:
    """The circle of the outline as seen from a middle ``(2,)``, or None where it is not round."""
    rim = points_mm[_rim(points_mm - middle_mm)]
    try:
        fit = fit_round(rim)
    except InputError:
        return None
    circle, used = fit.surface, fit.weights > 0.0
    agreeing = np.count_nonzero(np.abs(circle.distance(rim)) < spacing_mm)
    if agreeing < _AGREEING * _SECTORS or area_mm2 * circle.curvature**2 < _COVERED * np.pi:
        return None
    slopes = np.column_stack([(rim[used] - circle.centre) * abs(circle.curvature), np.ones(used.sum())])
    covariance = np.linalg.inv(slopes.T @ slopes) * fit.scale**2
    sigma = float(np.sqrt(covariance[:2, :2].trace() / 2.0))
    return Outline(circle.centre, float(abs(1.0 / circle.curvature)), sigma)


def _rim(from_middle: FloatArray) -> IntArray:
    """Index of the farthest point of each sector that has any."""
    sector = np.floor((np.arctan2(from_middle[:, 1], from_middle[:, 0]) / (2.0 * np.pi) + 0.5) * _SECTORS)
    order = np.lexsort((np.hypot(*from_middle.T), sector))
    last = np.flatnonzero(np.diff(sector[order], append=np.inf))
    return order[last]


def _hull_centroid(corners: FloatArray) -> FloatArray:
    """Centroid of a convex polygon ``(M, 2)``, corners in order."""
    following = np.roll(corners, -1, axis=0)
    cross = corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]
    return np.sum((corners + following) * cross[:, None], axis=0) / (3.0 * cross.sum())
