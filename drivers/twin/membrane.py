"""The speckled membrane of the inflation test: where each material point is under pressure, and where a ray hits it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from drivers.twin.inflation import Meridian, load_for_rise, solve
from drivers.twin.optics import FloatArray
from drivers.twin.options import MembraneOptions

#: Intervals of the ray kernel's table over the squared deformed radius.
TABLE = 512


@lru_cache(maxsize=8)
def _calibrated_load(rise: float) -> float:
    return load_for_rise(rise)


@lru_cache(maxsize=512)
def _meridian(load: float) -> Meridian:
    return solve(load)


@dataclass(frozen=True)
class Membrane:
    """A clamped circular membrane; its own frame is x', y', z' of DESIGN section 2, origin in the window's middle."""

    options: MembraneOptions

    @property
    def load_per_kpa(self) -> float:
        """p a / (mu H) of 1 kPa, from the calibration point."""
        options = self.options
        return _calibrated_load(options.calibration_rise_mm / options.radius_mm) / options.calibration_kpa

    @property
    def shear_modulus_mpa(self) -> float:
        """Neo-Hookean shear modulus mu that gives the calibrated rise."""
        return 1e-3 * self.options.radius_mm / (self.options.thickness_mm * self.load_per_kpa)

    def meridian(self, pressure_kpa: float) -> Meridian:
        """The solved shape in units of the radius. Raises `ValueError` for a pressure that the membrane can not bear."""
        try:
            return _meridian(pressure_kpa * self.load_per_kpa)
        except ValueError as err:
            raise ValueError(f"{pressure_kpa:g} kPa is more than the twin's membrane can bear; lower it") from err

    def rise_mm(self, pressure_kpa: float) -> float:
        """Height of the pole over the window."""
        return self.options.radius_mm * float(self.meridian(pressure_kpa).height[0])

    def positions(self, material_mm: FloatArray, pressure_kpa: float) -> FloatArray:
        """Where material points are, ``(N, 3)`` mm in the membrane's frame.

        ``material_mm`` ``(N, 2)``: (R, phi), the place on the flat membrane, mm and rad (phi from x' towards y').
        """
        radius, phi = np.asarray(material_mm, float).reshape(-1, 2).T
        a, shape = self.options.radius_mm, self.meridian(pressure_kpa)
        if np.any((radius < 0.0) | (radius > a * (1.0 + 1e-12))):
            raise ValueError(f"material radii must lie in 0..{a:g} mm, the membrane's radius")
        slope = -shape.radial_stretch * np.sqrt(1.0 - shape.cos_slope**2)
        deformed = CubicHermiteSpline(shape.material, shape.radius, shape.radial_stretch * shape.cos_slope)(radius / a)
        height = CubicHermiteSpline(shape.material, shape.height, slope)(radius / a)
        return a * np.stack([deformed * np.cos(phi), deformed * np.sin(phi), height], axis=-1)

    def green_lagrange(self, material_mm: FloatArray, pressure_kpa: float) -> FloatArray:
        """Green-Lagrange strain ``(N, 2)`` against the flat state: along the meridian and along the hoop."""
        radius = np.asarray(material_mm, float).reshape(-1, 2)[:, 0] / self.options.radius_mm
        shape = self.meridian(pressure_kpa)
        stretches = [CubicSpline(shape.material, s)(radius) for s in (shape.radial_stretch, shape.hoop_stretch)]
        return (np.stack(stretches, axis=-1) ** 2 - 1.0) / 2.0

    def table(self, pressure_kpa: float) -> FloatArray:
        """Cubic pieces ``(TABLE, 8)`` over the squared deformed radius, for `hit_membrane`.

        Four coefficients of the height (mm), then four of R / r, highest power first. As functions of the squared
        radius both are smooth at the pole.
        """
        a, shape = self.options.radius_mm, self.meridian(pressure_kpa)
        squared = (a * shape.radius) ** 2
        knots = np.linspace(0.0, a * a, TABLE + 1)
        pieces = []
        for values in (a * shape.height, 1.0 / shape.hoop_stretch):
            fine = CubicSpline(squared, values)
            pieces.append(CubicSpline(knots, fine(np.minimum(knots, squared[-1]))).c.T)
        return np.ascontiguousarray(np.concatenate(pieces, axis=1))


@njit(cache=True)
def _cubic(piece, first, t):
    """Value and slope of one cubic piece."""
    c3, c2, c1, c0 = piece[first], piece[first + 1], piece[first + 2], piece[first + 3]
    return ((c3 * t + c2) * t + c1) * t + c0, (3.0 * c3 * t + 2.0 * c2) * t + c1


@njit(cache=True)
def hit_membrane(ox, oy, oz, dx, dy, dz, radius, ring, table):
    """Where a ray (membrane frame, mm) meets the membrane or its clamping ring.

    Returns (what, u, v, x, y, z, nx, ny, nz): what 1 membrane, 2 ring, 0 neither; (u, v) the material point; the
    place; the outward normal. The cap is convex, so Newton's method from above its pole converges on the first
    crossing.
    """
    limit = radius * radius
    width = limit / table.shape[0]
    if dz < 0.0:
        t = (table[0, 3] - oz) / dz
        for _ in range(30):
            x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
            q = x * x + y * y
            k = min(int(q / width), table.shape[0] - 1)
            part = min(q, limit) - k * width
            height, slope = _cubic(table[k], 0, part)
            if q > limit:
                height += slope * (q - limit)
            step = (z - height) / (dz - slope * 2.0 * (x * dx + y * dy))
            if not step <= 1e3:
                break
            t -= step
            if abs(step) < 1e-10:
                if q <= limit:
                    stretch, _ = _cubic(table[k], 4, part)
                    norm = np.sqrt(1.0 + 4.0 * q * slope * slope)
                    nx, ny = -2.0 * slope * x / norm, -2.0 * slope * y / norm
                    return 1, x * stretch, y * stretch, x, y, z, nx, ny, 1.0 / norm
                break
        t = -oz / dz
        x, y = ox + t * dx, oy + t * dy
        q = x * x + y * y
        if limit < q <= (radius + ring) ** 2:
            return 2, x, y, x, y, 0.0, 0.0, 0.0, 1.0
    return 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
