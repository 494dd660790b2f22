"""Green-Lagrange strain of a tracked surface, frame by frame against one reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.analysis.surface.frame import MembraneFrame
from bscd.analysis.surface.green_lagrange import SurfaceGradient, principal
from bscd.analysis.surface.neighbourhoods import LocalFits, Neighbourhoods
from bscd.analysis.surface.strain_settings import StrainSettings, StrainStatus, StrainWindow
from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.errors import InputError

_LEAST_POINTS = 4


@dataclass(frozen=True)
class SurfaceStrain:
    """Strain of N points, in one frame or, with a leading axis, in T.

    ``strain`` ``(..., N, 3)``: exx, eyy, exy along x', y' projected into the reference's tangent plane. ``principal``
    ``(..., N, 2)``: e1 >= e2; ``angle_deg`` ``(..., N)``: from x' to the direction of e1, towards y'. ``sigma``
    ``(..., N, 3)``: standard uncertainty of exx, eyy, exy from the points' noise (not of what the polynomials can not
    follow), NaN where no sigma was given. ``status`` ``(..., N)``: `StrainStatus`; NaN wherever that is not 0.
    """

    strain: FloatArray
    principal: FloatArray
    angle_deg: FloatArray
    sigma: FloatArray
    status: IntArray


class StrainGauge:
    """Strain of points ``(N, 2)`` px of the reference view against their reference positions ``(N, 3)`` mm.

    Made once, then asked frame by frame (`measure`): the local fits are made once, and again only about points whose
    neighbours are missing in a frame. Positions along the surface and in depth (along the mean normal, which turns
    with the body) have polynomials of degrees of their own, so a rigid motion gives no strain whatever the degrees.
    """

    window: StrainWindow

    def __init__(
        self,
        points_px: FloatArray,
        reference_mm: FloatArray,
        *,
        settings: StrainSettings | None = None,
        reference_sigma_mm: FloatArray | None = None,
        frame: MembraneFrame | None = None,
    ) -> None:
        """Prepare for the points; rows of NaN were not measured in the reference and never have a strain.

        ``reference_sigma_mm`` ``(N, 3)`` is the reference's noise (none when left out). ``frame`` gives x' and z';
        without it x' is the world's x, and the normal points to where columns run right and rows down.

        Raises
        ------
        InputError
            Shapes that do not match, fewer than four points, or no room for a window.
        """
        self._settings = settings or StrainSettings()
        points_px, reference_mm = np.asarray(points_px, np.float64), np.asarray(reference_mm, np.float64)
        if points_px.ndim != 2 or points_px.shape[1] != 2 or reference_mm.shape != (len(points_px), 3):
            raise InputError(
                f"strain needs points (N, 2) px and (N, 3) mm, not {points_px.shape} and {reference_mm.shape}"
            )
        self._count = len(points_px)
        self._measured = np.flatnonzero(np.isfinite(np.hstack([points_px, reference_mm])).all(axis=1))
        if len(self._measured) < _LEAST_POINTS:
            raise InputError(f"strain needs at least {_LEAST_POINTS} points; {len(self._measured)} are measured")
        sigma = matching(reference_mm, reference_sigma_mm, "reference_sigma_mm")
        points_px, self._reference = points_px[self._measured], reference_mm[self._measured]
        self._reference_variance = sigma[self._measured] ** 2
        self.window = self._settings.window(points_px, self._reference)
        self._x_axis = np.array([1.0, 0.0, 0.0]) if frame is None else frame.axes[0]
        self._outward = None if frame is None else frame.axes[2]
        self._near = Neighbourhoods.of(points_px, self.window.half_px)
        self._status, self._complete = self._fit(np.ones(len(points_px), bool), np.ones(len(points_px), bool))
        self._reference_slopes = self._slopes(self._reference, [self._complete])
        self._noise: FloatArray | None = None
        self._last: tuple[BoolArray, IntArray, list[LocalFits]] | None = None

    def measure(self, current_mm: FloatArray, sigma_mm: FloatArray | None = None) -> SurfaceStrain:
        """Strain of one frame: the points' positions ``(N, 3)`` mm now (NaN: lost), their noise ``(N, 3)`` mm.

        Raises
        ------
        InputError
            Shapes that do not match.
        """
        current_mm = np.asarray(current_mm, dtype=np.float64)
        if current_mm.shape != (self._count, 3):
            raise InputError(f"a frame of this gauge has {self._count} points (N, 3), not shape {current_mm.shape}")
        sigma = matching(current_mm, sigma_mm, "sigma_mm")[self._measured]
        current = current_mm[self._measured]
        valid = np.asarray(np.isfinite(current).all(axis=1))
        status, fits = self._fits(valid)
        good = np.flatnonzero(status == StrainStatus.VALID)
        result = _nothing(self._count)
        result.status[self._measured] = status
        if len(good) == 0:
            return result
        there = self._measured[good]
        now = _mixed(self._slopes(np.where(valid[:, None], current, 0.0), fits)[good])
        before = _mixed(self._slopes(self._reference, fits[1:], self._reference_slopes)[good])
        gradient = SurfaceGradient.between(before[0], now[0], self._x_axis, self._outward)
        result.strain[there] = gradient.strain()
        result.principal[there], result.angle_deg[there] = principal(result.strain[there])
        if sigma_mm is not None:
            noise = self._unit_noise(fits)[good]
            variance = np.where(valid[:, None], sigma**2, 0.0)
            by_now, by_before = gradient.sensitivity()
            total = _passed(by_now, now[1], noise, self._local(variance, fits)[good])
            total += _passed(by_before, before[1], noise, self._local(self._reference_variance, fits)[good])
            result.sigma[there] = np.sqrt(total)
        return result

    def _fits(self, valid: BoolArray) -> tuple[IntArray, list[LocalFits]]:
        """Statuses, and the complete fits, but others where a neighbour is missing."""
        if valid.all():
            return self._status, [self._complete]
        if self._last is None or not np.array_equal(self._last[0], valid):
            touched = self._near.touched_by(np.flatnonzero(~valid))
            renewed, fits = self._fit(touched & valid & (self._status == StrainStatus.VALID), valid, self._complete)
            status = np.where(renewed == StrainStatus.UNMEASURED, self._status, renewed)
            status[~valid] = StrainStatus.UNMEASURED
            self._last = valid, status, [self._complete.only(~touched[self._complete.rows]), fits]
        return self._last[1], self._last[2]

    def _fit(self, where: BoolArray, valid: BoolArray, complete: LocalFits | None = None) -> tuple[IntArray, LocalFits]:
        """Statuses (unmeasured but ``where``), and the fits of those that are valid."""
        settings = self._settings
        fits = self._near.fit(np.flatnonzero(where), valid, settings.order, settings.depth_order, complete)
        enough = (fits.start >= 0) & (fits.count >= settings.least_share * self.window.window_points**2)
        centred = fits.offset <= settings.largest_offset
        status = np.full(len(valid), StrainStatus.UNMEASURED, dtype=np.int64)
        status[fits.rows] = np.where(centred, StrainStatus.VALID, StrainStatus.ONE_SIDED)
        status[fits.rows[~enough]] = StrainStatus.FEW_NEIGHBOURS
        return status, fits.only(enough & centred)

    def _slopes(self, positions: FloatArray, fits: list[LocalFits], base: FloatArray | None = None) -> FloatArray:
        """Derivatives ``(K, 3, 4)`` of positions ``(K, 3)``, over a base where the fits say nothing."""
        slopes = np.full((len(positions), 3, 4), np.nan) if base is None else base.copy() if fits else base
        for fit in fits:
            self._near.derivatives(fit, positions, slopes)
        return slopes

    def _local(self, variance: FloatArray, fits: list[LocalFits]) -> FloatArray:
        mean = np.full(variance.shape, np.nan)
        for fit in fits:
            self._near.local_mean(fit, variance, mean)
        return mean

    def _unit_noise(self, fits: list[LocalFits]) -> FloatArray:
        """Covariance ``(K, 4, 4)`` of the derivatives for unit noise.

        Where neighbours are missing, the complete window's, scaled with the sums of squared weights: exact for noise
        that points do not share, and an upper estimate where they do (by a tenth when a fifth of the points is lost).
        """
        if self._noise is None:
            self._noise = self._near.noise(self._complete, self.window.subset_px if self._settings.correlated else 0.0)
        if len(fits) == 1:
            return self._noise
        rows = fits[1].rows
        grown = np.sqrt(self._near.squares(fits[1])[rows] / self._near.squares(self._complete)[rows])
        noise = self._noise.copy()
        noise[rows] *= grown[:, :, None] * grown[:, None, :]
        return noise


def matching(positions_mm: FloatArray, sigma_mm: FloatArray | None, name: str) -> FloatArray:
    """Sigmas of the shape of their positions, 0 when left out; raises `InputError` where they do not match."""
    if sigma_mm is None:
        return np.zeros(positions_mm.shape)
    sigma_mm = np.asarray(sigma_mm, dtype=np.float64)
    if sigma_mm.shape != positions_mm.shape:
        raise InputError(f"{name} has shape {sigma_mm.shape}, its points {positions_mm.shape}")
    return sigma_mm


def _nothing(points: int) -> SurfaceStrain:
    return SurfaceStrain(
        np.full((points, 3), np.nan),
        np.full((points, 2), np.nan),
        np.full(points, np.nan),
        np.full((points, 3), np.nan),
        np.full(points, StrainStatus.UNMEASURED, dtype=np.int64),
    )


def _mixed(slopes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives ``(M, 3, 2)`` by column and row, in depth those of the depth's fit; and the mean normal ``(3,)``.

    ``slopes`` ``(M, 3, 4)`` as the kernels give them. The mean normal is the surface's vector area.
    """
    along, deep = slopes[:, :, :2], slopes[:, :, 2:]
    normal = np.cross(along[:, :, 1], along[:, :, 0]).sum(axis=0)
    normal /= np.linalg.norm(normal)
    return along + normal[:, None] * (normal @ (deep - along))[:, None, :], normal


def _passed(by_slopes: FloatArray, normal: FloatArray, noise: FloatArray, variance: FloatArray) -> FloatArray:
    """Variance ``(M, 3)`` of the strains from that of positions, ``(M, 3)`` mm^2.

    ``by_slopes`` ``(M, 3, 3, 2)`` are the strains' derivatives by the mixed slopes, ``noise`` ``(M, 4, 4)`` the
    covariance of the slopes in both degrees for unit noise of a component.
    """
    in_depth = (normal @ by_slopes)[:, :, None, :] * normal[:, None]
    by_both = np.concatenate([by_slopes - in_depth, in_depth], axis=3)
    return np.sum(np.sum(by_both @ noise[:, None] * by_both, axis=3) * variance[:, None, :], axis=2)
