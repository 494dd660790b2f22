"""Volumetric distortion maps: four shifts as functions of the uncorrected position, with their covariance.

Two interpolants over the same control points: piecewise linear on a Delaunay tessellation, as in the paper, and a
smooth polynomial of low degree.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, KDTree

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.errors import InputError

MAX_DEGREE = 4

_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
_STRETCHED = 2.5  # times the usual longest edge
_CANDIDATES = 24


class DistortionMap(Protocol):
    """Shifts and their covariance anywhere in the volume."""

    def shifts_px(self, points_mm: FloatArray) -> FloatArray:
        """Shifts ``(N, 4)`` px at uncorrected positions ``(N, 3)`` mm; NaN where there is no map."""
        ...

    def covariance_px2(self, points_mm: FloatArray) -> FloatArray:
        """Covariance ``(N, 4, 4)`` px^2 of the shifts; grows away from the control points."""
        ...

    def difference_covariance_px2(self, points_mm: FloatArray, others_mm: FloatArray) -> FloatArray:
        """Covariance ``(N, 4, 4)`` px^2 of the difference between the shifts at two positions."""
        ...


@dataclass(frozen=True)
class SmoothMap:
    """Polynomials in (x, y, z), every product of total degree <= ``degree``, fitted by least squares.

    ``centre_mm`` and ``half_width_mm`` ``(3,)`` scale the volume to -1..1; ``coefficients`` ``(T, 4)`` px;
    ``normal_inverse`` ``(T, T)``; ``residual_covariance_px2`` ``(4, 4)`` of the control points about the fit.
    """

    degree: int
    centre_mm: FloatArray
    half_width_mm: FloatArray
    coefficients: FloatArray
    normal_inverse: FloatArray
    residual_covariance_px2: FloatArray

    def shifts_px(self, points_mm: FloatArray) -> FloatArray:
        """The polynomials' values ``(N, 4)`` px, also beyond the control points."""
        return _terms(points_mm, self.degree, self.centre_mm, self.half_width_mm) @ self.coefficients

    def covariance_px2(self, points_mm: FloatArray) -> FloatArray:
        """Covariance of the fitted values, ``(N, 4, 4)`` px^2."""
        terms = _terms(points_mm, self.degree, self.centre_mm, self.half_width_mm)
        return self._covariance(terms)

    def difference_covariance_px2(self, points_mm: FloatArray, others_mm: FloatArray) -> FloatArray:
        """Covariance ``(N, 4, 4)`` px^2 of the difference between the shifts at two positions each ``(N, 3)`` mm."""
        terms = [_terms(at, self.degree, self.centre_mm, self.half_width_mm) for at in (points_mm, others_mm)]
        return self._covariance(terms[0] - terms[1])

    def _covariance(self, terms: FloatArray) -> FloatArray:
        leverage = np.einsum("ni,ni->n", terms @ self.normal_inverse, terms)
        return leverage[:, None, None] * self.residual_covariance_px2


def _terms(points_mm: FloatArray, degree: int, centre_mm: FloatArray, half_width_mm: FloatArray) -> FloatArray:
    """Every product of powers, ``(N, T)``, of positions scaled to -1..1."""
    scaled = (points_mm - centre_mm) / half_width_mm
    powers = [np.ones_like(scaled.T)]
    for _ in range(degree):
        powers.append(powers[-1] * scaled.T)
    return np.stack([powers[a][0] * powers[b][1] * powers[c][2] for a, b, c in _exponents(degree)], axis=1)


def _exponents(degree: int) -> list[tuple[int, int, int]]:
    return [(a, b, c) for a, b, c in product(range(degree + 1), repeat=3) if a + b + c <= degree]


def fit_smooth_map(points_mm: FloatArray, shifts_px: FloatArray, degree: int = MAX_DEGREE) -> SmoothMap:
    """Fit the smooth map to control points ``(M, 3)`` mm and their shifts ``(M, 4)`` px.

    Raises
    ------
    InputError
        A degree outside 1..4, or control points that do not determine it.
    """
    if not 1 <= degree <= MAX_DEGREE:
        raise InputError(f"distortion map: degree {degree}, allowed are 1 to {MAX_DEGREE}")
    low, high = points_mm.min(axis=0), points_mm.max(axis=0)
    centre, half_width = (low + high) / 2, (high - low) / 2
    terms = _terms(points_mm, degree, centre, half_width)
    if np.linalg.matrix_rank(terms) < terms.shape[1]:
        raise InputError(
            f"distortion map: {len(points_mm)} control points do not determine degree {degree}; "
            "scan more positions or lower the degree"
        )
    coefficients = np.linalg.lstsq(terms, shifts_px, rcond=None)[0]
    residual = shifts_px - terms @ coefficients
    covariance = residual.T @ residual / max(len(terms) - terms.shape[1], 1)
    inverse = np.linalg.inv(terms.T @ terms)
    return SmoothMap(degree, centre, half_width, coefficients, inverse, covariance)


@dataclass(frozen=True)
class LinearMap:
    """Piecewise-linear interpolation on the Delaunay tessellation of the control points (as griddata3).

    Outside the tessellation it takes ``beyond``, the smooth map. ``noise_covariance_px2`` ``(4, 4)`` is the control
    points' own, taken from their scatter about the smooth map.
    """

    tessellation: Delaunay
    shifts: FloatArray
    beyond: SmoothMap

    def shifts_px(self, points_mm: FloatArray) -> FloatArray:
        """Interpolated shifts ``(N, 4)`` px."""
        inside, vertices, weights = self._barycentric(points_mm)
        values = self.beyond.shifts_px(points_mm)
        values[inside] = np.einsum("nv,nvk->nk", weights, self.shifts[vertices])
        return values

    def covariance_px2(self, points_mm: FloatArray) -> FloatArray:
        """Covariance ``(N, 4, 4)`` px^2 that the control points' noise leaves in the interpolated shifts."""
        inside, _, weights = self._barycentric(points_mm)
        covariance = self.beyond.covariance_px2(points_mm)
        covariance[inside] = np.sum(weights**2, axis=1)[:, None, None] * self.beyond.residual_covariance_px2
        return covariance

    def difference_covariance_px2(self, points_mm: FloatArray, others_mm: FloatArray) -> FloatArray:
        """Covariance ``(N, 4, 4)`` px^2 of the difference between two shifts, as the smooth map has it."""
        return self.beyond.difference_covariance_px2(points_mm, others_mm)

    def _barycentric(self, points_mm: FloatArray) -> tuple[BoolArray, NDArray[np.int32], FloatArray]:
        """Which points lie in the tessellation, and for those their tetrahedron's corners and weights, ``(K, 4)``."""
        simplex = self.tessellation.find_simplex(points_mm)
        inside = simplex >= 0
        at, chosen = points_mm[inside], simplex[inside].astype(np.int64)
        stretched = ~self._compact[chosen]
        if stretched.any():
            chosen[stretched] = self._beside(at[stretched])
        return inside, self.tessellation.simplices[chosen], self._weights(chosen, at)

    @cached_property
    def _compact(self) -> BoolArray:
        """Tetrahedra that are local.

        The hull of a nearly regular grid is covered by flat slivers that join dots from end to end of a face; what
        they interpolate is not "information from the nearby control points" (paper, section 3).
        """
        corners = self.tessellation.points[self.tessellation.simplices]
        longest = np.max([np.linalg.norm(corners[:, i] - corners[:, j], axis=1) for i, j in _EDGES], axis=0)
        return longest <= _STRETCHED * np.median(longest)

    @cached_property
    def _centroids(self) -> tuple[IntArray, KDTree]:
        compact = np.flatnonzero(self._compact)
        return compact, KDTree(self.tessellation.points[self.tessellation.simplices[compact]].mean(axis=1))

    def _beside(self, points_mm: FloatArray) -> IntArray:
        """The compact tetrahedron that each point in a flat one lies in or next to."""
        compact, tree = self._centroids
        near = compact[tree.query(points_mm, k=min(_CANDIDATES, len(compact)))[1]]
        fit = np.stack([self._weights(column, points_mm).min(axis=1) for column in near.T], axis=1)
        return near[np.arange(len(near)), np.argmax(fit, axis=1)]

    def _weights(self, simplex: IntArray, points_mm: FloatArray) -> FloatArray:
        transform = self.tessellation.transform[simplex]
        first = np.einsum("nij,nj->ni", transform[:, :3], points_mm - transform[:, 3])
        return np.nan_to_num(np.column_stack([first, 1.0 - first.sum(axis=1)]), nan=-np.inf, neginf=-np.inf)
