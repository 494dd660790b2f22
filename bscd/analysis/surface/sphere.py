"""The sphere nearest to measured points (DESIGN section 3, step 5; paper, section 2.2.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.analysis.surface.round_fit import RoundFit, fit_round
from bscd.arrays import BoolArray, FloatArray
from bscd.errors import InputError

#: A sphere's curvature must be this many of its standard uncertainties, or the points are flat.
_SIGNIFICANT = 5.0
_FLAT = 1e-9  # extent across over extent along


@dataclass(frozen=True)
class SphereFit:
    """A sphere fitted to points ``(N, 3)``.

    ``centre_mm`` ``(3,)`` and ``radius_mm``; ``deviation_mm`` ``(N,)`` is a point's distance to the centre less the
    radius, NaN where the point is; ``used`` ``(N,)`` says which points took part: not those that the robust weights
    cut off. ``covariance_mm2`` ``(4, 4)`` is that of centre and radius (a given radius has zeros), for independent
    points. ``scale`` is the scatter over the sigma that was given, else the scatter's standard deviation in mm.
    """

    centre_mm: FloatArray
    radius_mm: float
    deviation_mm: FloatArray
    used: BoolArray
    covariance_mm2: FloatArray
    scale: float

    @property
    def centre_sigma_mm(self) -> FloatArray:
        """Standard uncertainty of the centre ``(3,)``."""
        return np.sqrt(np.diag(self.covariance_mm2)[:3])

    @property
    def radius_sigma_mm(self) -> float:
        """Standard uncertainty of the radius; 0 for a given one."""
        return float(np.sqrt(self.covariance_mm2[3, 3]))

    @property
    def mean_mm(self) -> float:
        """Mean radial deviation of the points that took part."""
        return float(self.deviation_mm[self.used].mean())

    @property
    def std_mm(self) -> float:
        """Standard deviation of their radial deviations about the mean."""
        return float(self.deviation_mm[self.used].std())


def fit_sphere(
    xyz_mm: FloatArray,
    *,
    sigma_mm: FloatArray | None = None,
    radius_mm: float | None = None,
    robust: bool = True,
    rng: np.random.Generator | None = None,
) -> SphereFit:
    """The sphere of least squared radial deviations of points ``(N, 3)`` mm; rows with NaN take no part.

    ``sigma_mm`` ``(N,)`` or ``(N, 3)`` weighs the points and sets the uncertainty; without it that follows from the
    scatter. ``radius_mm`` fixes the radius at a nominal value. ``robust`` keeps up to 40 % of gross outliers from
    moving the sphere (`fit_round`); ``rng`` draws its samples, the same ones each time unless given.

    Raises
    ------
    InputError
        Wrong shapes or values, too few points, or points that show no curvature (on a plane, circle or line).
    """
    xyz_mm = np.asarray(xyz_mm, dtype=np.float64)
    if xyz_mm.ndim != 2 or xyz_mm.shape[1] != 3:
        raise InputError(f"a sphere is fitted to points (N, 3), not to an array of shape {xyz_mm.shape}")
    if radius_mm is not None and not (np.isfinite(radius_mm) and radius_mm > 0.0):
        raise InputError(f"the sphere's radius must be a positive number of mm, not {radius_mm:g}")
    sigma = _sigma(sigma_mm, xyz_mm.shape)
    known = np.isfinite(xyz_mm).all(axis=1) & np.isfinite(sigma).all(axis=1)
    unknowns = 3 if radius_mm is not None else 4
    least = 3 * unknowns if robust else unknowns + 1
    if np.count_nonzero(known) < least:
        kind = "robust " if robust else ""
        raise InputError(f"a {kind}sphere fit needs at least {least} points; {np.count_nonzero(known)} are known")
    points = xyz_mm[known]
    _spread_or_refuse(points)
    radial = None
    if sigma_mm is not None:
        radial = sigma[known, 0] if sigma.shape[1] == 1 else _radial(sigma[known], points, robust, rng)
    free = fit_round(points, sigma=radial, robust=robust, rng=rng)
    _curved_or_refuse(free)
    fit = free
    if radius_mm is not None:
        fit = fit_round(points, sigma=radial, curvature=1.0 / radius_mm, robust=robust, rng=rng)
    centre, radius = fit.surface.centre, abs(1.0 / fit.surface.curvature)
    used = np.zeros(len(xyz_mm), dtype=bool)
    used[known] = fit.weights > 0.0
    return SphereFit(
        centre,
        radius,
        radial_deviation(xyz_mm, centre, radius),
        used,
        _covariance(fit),
        fit.scale,
    )


def radial_deviation(xyz_mm: FloatArray, centre_mm: FloatArray, radius_mm: float) -> FloatArray:
    """Distances ``(N,)`` mm of points ``(N, 3)`` to a centre ``(3,)``, less the radius."""
    return np.linalg.norm(np.asarray(xyz_mm) - np.asarray(centre_mm), axis=1) - radius_mm


def _sigma(sigma_mm: FloatArray | None, shape: tuple[int, ...]) -> FloatArray:
    """Sigmas ``(N, 1)`` or ``(N, 3)``, checked."""
    if sigma_mm is None:
        return np.ones((shape[0], 1))
    sigma = np.asarray(sigma_mm, dtype=np.float64)
    if sigma.shape not in (shape[:1], shape):
        raise InputError(f"sigma_mm has shape {sigma.shape}; points {shape} need {shape[:1]} or {shape}")
    if np.any(sigma <= 0.0):
        raise InputError("sigma_mm must be positive; leave it out where it is not known")
    return sigma.reshape(shape[0], -1)


def _radial(sigma: FloatArray, points: FloatArray, robust: bool, rng: np.random.Generator | None) -> FloatArray:
    """Sigmas ``(N,)`` along the normals of a first fit, from those along x, y, z ``(N, 3)``."""
    surface = fit_round(points, robust=robust, rng=rng).surface
    normal = surface.normal + surface.curvature * (points - surface.anchor)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.sqrt(np.sum((normal * sigma) ** 2, axis=1))


def _spread_or_refuse(points: FloatArray) -> None:
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if extent[1] <= _FLAT * extent[0]:
        raise InputError("the points lie on a line (or in one place); a sphere needs points spread over a surface")
    if extent[2] <= _FLAT * extent[0]:
        raise InputError("the points lie on a plane; no sphere can be told from them")


def _curved_or_refuse(fit: RoundFit) -> None:
    scatter = max(fit.scale, 1.0) if fit.scale_is_relative else 1.0
    sigma = float(np.sqrt(fit.covariance[-1, -1])) * scatter
    if not abs(fit.surface.curvature) > _SIGNIFICANT * sigma:
        raise InputError("the points are flat within their scatter; no sphere can be told from them")


def _covariance(fit: RoundFit) -> FloatArray:
    """Covariance ``(4, 4)`` of centre and radius from that of lift, turns and curvature: c = anchor - normal / k."""
    surface = fit.surface
    curvature = surface.curvature
    to_sphere = np.zeros((4, 4))
    to_sphere[:3, 0] = surface.normal
    to_sphere[:3, 1:3] = -surface.turns.T / curvature
    to_sphere[:3, 3] = surface.normal / curvature**2
    to_sphere[3, 3] = -np.sign(curvature) / curvature**2
    return to_sphere @ fit.covariance @ to_sphere.T
