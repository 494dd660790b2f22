"""Geometric (orthogonal distance) least squares of circles, spheres and flat limits, robust against outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.analysis.surface.robust_start import through, trimmed_start
from bscd.analysis.surface.round_surface import RoundSurface
from bscd.arrays import FloatArray
from bscd.errors import InputError

#: Tukey's biweight with this constant keeps this much of least squares' efficiency on Gaussian noise.
BIWEIGHT, _EFFICIENCY = 4.685, 0.95
#: The median absolute deviation of Gaussian noise, inverted.
_MAD_TO_SIGMA = 1.482602218505602
#: Times that the scale is taken anew; ten are usual.
_RESCALED = 30
_ITERATIONS = 200
_CONVERGED = 1e-13
_STALLED = 1e-9


@dataclass(frozen=True)
class RoundFit:
    """What `fit_round` finds for points ``(N, d)``.

    ``weights`` ``(N,)`` are Tukey's, 1 .. 0 (0: took no part); ``scale`` is the noise's standard deviation, in units
    of the sigma that was given, else in the points' unit. ``covariance`` ``(d + 1, d + 1)`` is that of the parameters
    of `RoundSurface.derivatives`; a curvature that was given has zeros there.
    """

    surface: RoundSurface
    weights: FloatArray
    scale: float
    covariance: FloatArray
    scale_is_relative: bool


def fit_round(
    points: FloatArray,
    *,
    sigma: FloatArray | None = None,
    curvature: float | None = None,
    robust: bool = True,
    rng: np.random.Generator | None = None,
) -> RoundFit:
    """Fit a circle or sphere to finite points ``(N, d)``, its curvature free or given in size.

    ``sigma`` ``(N,)`` is the standard deviation of a point along the normal. The robust fit starts from least trimmed
    squares and iterates Tukey's biweight with the median absolute deviation as its scale until both stand still
    (Huber and Ronchetti, "Robust Statistics", 2nd ed., 2009). The covariance is that of least squares on the points
    that took part, over the biweight's efficiency, and follows from ``sigma`` where it is given, else from the scatter.

    Raises
    ------
    InputError
        The points have no circle or sphere, or the iteration does not settle.
    """
    middle = points.mean(axis=0)
    size = float(np.sqrt(np.mean((points - middle) ** 2) * points.shape[1]))
    unit = (points - middle) / size
    relative = np.ones(len(unit)) if sigma is None else sigma / size
    start = trimmed_start(unit, rng or np.random.default_rng(0)) if robust else through(unit)
    if start is None:
        raise InputError("the points lie on no circle or sphere; give points that spread over a surface")
    if curvature is not None:
        sense = -1.0 if start.curvature < 0.0 else 1.0
        start = RoundSurface(start.anchor, start.normal, sense * curvature * size)
    state = _Iteration(unit, relative, free=curvature is None)
    scale = state.scale(start) if robust else np.inf
    surface = state.settle(start, scale)
    for _ in range(_RESCALED if robust else 0):
        last, scale = scale, state.scale(surface)
        if abs(scale - last) <= _STALLED * scale:
            break
        surface = state.settle(surface, scale)
    covariance, found = state.covariance(surface, scale)
    spread = found if sigma is None else 1.0
    to_points = np.ones(points.shape[1] + 1)
    to_points[0], to_points[-1] = size, 1.0 / size
    return RoundFit(
        RoundSurface(middle + size * surface.anchor, surface.normal, surface.curvature / size),
        state.weights(surface, scale),
        found * (size if sigma is None else 1.0),
        covariance * spread**2 * np.outer(to_points, to_points),
        scale_is_relative=sigma is not None,
    )


@dataclass(frozen=True)
class _Iteration:
    """Reweighted Gauss-Newton on points of unit extent."""

    points: FloatArray
    sigma: FloatArray
    free: bool

    @property
    def unknowns(self) -> int:
        return self.points.shape[1] + int(self.free)

    def scale(self, surface: RoundSurface) -> float:
        residual = np.abs(surface.distance(self.points)) / self.sigma
        correction = np.sqrt(len(residual) / (len(residual) - self.unknowns))
        return max(_MAD_TO_SIGMA * float(np.median(residual)) * correction, 1e-13 / float(np.median(self.sigma)))

    def weights(self, surface: RoundSurface, scale: float) -> FloatArray:
        reduced = surface.distance(self.points) / (self.sigma * scale * BIWEIGHT)
        return np.where(np.abs(reduced) < 1.0, (1.0 - reduced**2) ** 2, 0.0)

    def slopes(self, surface: RoundSurface) -> FloatArray:
        return (surface.derivatives(self.points) / self.sigma[:, None])[:, : self.unknowns]

    def settle(self, surface: RoundSurface, scale: float) -> RoundSurface:
        last = np.inf
        for _ in range(_ITERATIONS):
            root = np.sqrt(self.weights(surface, scale))
            step = np.zeros(self.points.shape[1] + 1)
            slopes, residual = self.slopes(surface), surface.distance(self.points) / self.sigma
            step[: self.unknowns] = -np.linalg.lstsq(slopes * root[:, None], residual * root, rcond=None)[0]
            surface = surface.moved(step)
            length = float(np.linalg.norm(step))
            if length < _CONVERGED or (length < _STALLED and length >= last):
                return surface
            last = length
        raise InputError("the fit of a circle or sphere does not settle; its points do not lie near one")

    def covariance(self, surface: RoundSurface, scale: float) -> tuple[FloatArray, float]:
        """Covariance ``(d + 1, d + 1)`` for noise of the given sigma, and the noise's scale from the residuals."""
        used = self.weights(surface, scale) > 0.0
        slopes = self.slopes(surface)[used]
        whole = np.zeros((self.points.shape[1] + 1,) * 2)
        whole[: self.unknowns, : self.unknowns] = np.linalg.pinv(slopes.T @ slopes, hermitian=True)
        residual = surface.distance(self.points[used]) / self.sigma[used]
        freedom = max(int(used.sum()) - self.unknowns, 1)
        return whole / (_EFFICIENCY if np.isfinite(scale) else 1.0), float(np.sqrt(np.sum(residual**2) / freedom))
