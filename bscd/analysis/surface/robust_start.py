"""Where a robust fit of a circle or sphere begins: least trimmed squares, which half of the points may not deceive."""

from __future__ import annotations

import numpy as np

from bscd.analysis.surface.round_surface import RoundSurface, true_distance
from bscd.arrays import FloatArray

#: Samples of d + 1 points: with 40 % outliers the odds that all of them are spoilt are below 1e-7.
_SAMPLES = 120
#: Points that judge a sample; more would only cost time.
_JUDGES = 1000
#: Samples that are concentrated, and the steps of it (Rousseeuw and Van Driessen 2006, FAST-LTS).
_KEPT, _STEPS = 6, 8


def trimmed_start(points: FloatArray, rng: np.random.Generator) -> RoundSurface | None:
    """The surface whose best half of squared distances is smallest, of points ``(N, d)`` of about unit extent.

    None where no sample of d + 1 points has a circle or sphere. Source: Rousseeuw and Van Driessen, "Computing LTS
    regression for large data sets" (2006): elemental samples, then concentration steps.
    """
    if len(points) > _JUDGES:
        points = rng.permutation(points)[:_JUDGES]
    count, dimensions = points.shape
    half = (count + dimensions + 2) // 2
    picks = np.argsort(rng.random((_SAMPLES, count)), axis=1)[:, : dimensions + 1]
    algebraic = np.linalg.svd(_design(points[picks]), full_matrices=True)[2][:, -1]
    order = np.argsort(_trimmed(_algebraic_distances(algebraic, points), half))
    surfaces = [_surface(coefficients, points.mean(axis=0)) for coefficients in algebraic[order[:_KEPT]]]
    found = [_concentrated(surface, points, half) for surface in surfaces if surface is not None]
    return min(found, key=lambda surface: _trimmed(surface.distance(points), half), default=None)


def through(points: FloatArray) -> RoundSurface | None:
    """The circle or sphere nearest to points ``(N, d)`` algebraically; through all of them for N = d + 1."""
    return _surface(np.linalg.svd(_design(points), full_matrices=True)[2][-1], points.mean(axis=0))


def _design(points: FloatArray) -> FloatArray:
    """Rows |x|^2 / 2, x, 1 of points ``(..., N, d)``; a circle or sphere is normal to those of its points."""
    squares = 0.5 * np.sum(points**2, axis=-1, keepdims=True)
    return np.concatenate([squares, points, np.ones_like(squares)], axis=-1)


def _surface(coefficients: FloatArray, near: FloatArray) -> RoundSurface | None:
    return RoundSurface.from_algebraic(coefficients[0], coefficients[1:-1], coefficients[-1], near)


def _algebraic_distances(coefficients: FloatArray, points: FloatArray) -> FloatArray:
    """Distances ``(S, N)`` of points ``(N, d)`` to surfaces of coefficients ``(S, d + 2)``; infinite for empty ones."""
    a, b, c = coefficients[:, 0], coefficients[:, 1:-1], coefficients[:, -1]
    squared = np.sum(b**2, axis=1) - 2.0 * a * c
    size = np.sqrt(np.where(squared > 0.0, squared, 1.0))[:, None]
    distances = true_distance((coefficients / size) @ _design(points).T, a[:, None] / size)
    return np.where(squared[:, None] > 0.0, distances, np.inf)


def _trimmed(distances: FloatArray, half: int):
    """Sum of the smaller half of the squared distances ``(..., N)``."""
    return np.partition(distances**2, half - 1, axis=-1)[..., :half].sum(axis=-1)


def _concentrated(surface: RoundSurface, points: FloatArray, half: int) -> RoundSurface:
    """Gauss-Newton steps, each on the half of the points that is nearest; the best surface on the way."""
    best, best_sum = surface, _trimmed(surface.distance(points), half)
    for _ in range(_STEPS):
        distance = surface.distance(points)
        nearest = np.argpartition(distance**2, half - 1)[:half]
        slopes = surface.derivatives(points[nearest])
        surface = surface.moved(-np.linalg.lstsq(slopes, distance[nearest], rcond=None)[0])
        total = _trimmed(surface.distance(points), half)
        if not total < best_sum:
            break
        best, best_sum = surface, total
    return best
