"""The speckled membrane of the inflation test: where each material point is under pressure, and where a ray hits it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.polynomial import Chebyshev, Polynomial
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from drivers.twin.inflation import Meridian, load_for_rise, solve
from drivers.twin.optics import FloatArray
from drivers.twin.options import MembraneOptions

#: Degree of the ray kernel's polynomials in the squared deformed radius.
DEGREE = 14

#: Numbers that `Membrane.polynomials` packs.
SHAPE_NUMBERS = 2 * (DEGREE + 1) + 1

#: Newton steps to a ray's crossing; quadratic convergence from the pole's height leaves the last below 1e-9 mm.
NEWTON_STEPS = 7


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
        """The load p a / (mu H) of 1 kPa, from the calibration point."""
        options = self.options
        return _calibrated_load(options.calibration_rise_mm / options.radius_mm) / options.calibration_kpa

    @property
    def shear_modulus_mpa(self) -> float:
        """Neo-Hookean shear modulus mu that gives the calibrated rise."""
        return 1e-3 * self.options.radius_mm / (self.options.thickness_mm * self.load_per_kpa)

    def meridian(self, pressure_kpa: float) -> Meridian:
        """The solved shape in units of the radius. Raises `ValueError` where the membrane can not bear it."""
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

    def polynomials(self, pressure_kpa: float) -> tuple[float, ...]:
        """Numbers for the ray kernels: the pole's height, then 15 coefficients of the height (mm) and 15 of R / r.

        Highest power first. As functions of (r / a)^2 both are analytic; the polynomials follow the solution to
        1e-7 mm up to 16 kPa.
        """
        a, shape = self.options.radius_mm, self.meridian(pressure_kpa)
        squared = shape.radius**2
        squared[-1] = 1.0
        nodes = (1.0 - np.cos(np.pi * (np.arange(4 * DEGREE) + 0.5) / (4 * DEGREE))) / 2.0
        packed = [a * float(shape.height[0])]
        for values in (a * shape.height, 1.0 / shape.hoop_stretch):
            fitted = Chebyshev.fit(nodes, CubicSpline(squared, values)(nodes), DEGREE, domain=[0.0, 1.0])
            powers = fitted.convert(kind=Polynomial).coef  # without trailing zeros
            packed.extend(np.pad(powers, (0, DEGREE + 1 - len(powers)))[::-1].tolist())
        return tuple(packed)


@njit(inline="always")
def _polynomial(c, q):
    """Value and slope by Horner's rule; written out, since a loop over a tuple would leave the registers."""
    value, slope = c[0] * q + c[1], c[0]
    value, slope = value * q + c[2], slope * q + value
    value, slope = value * q + c[3], slope * q + value
    value, slope = value * q + c[4], slope * q + value
    value, slope = value * q + c[5], slope * q + value
    value, slope = value * q + c[6], slope * q + value
    value, slope = value * q + c[7], slope * q + value
    value, slope = value * q + c[8], slope * q + value
    value, slope = value * q + c[9], slope * q + value
    value, slope = value * q + c[10], slope * q + value
    value, slope = value * q + c[11], slope * q + value
    value, slope = value * q + c[12], slope * q + value
    value, slope = value * q + c[13], slope * q + value
    value, slope = value * q + c[14], slope * q + value
    return value, slope


@njit(inline="always")
def newton_step(t, ox, oy, oz, dx, dy, dz, radius, shape):
    """One step of Newton's method for where a ray (membrane frame, mm) crosses the membrane: the step to take from t.

    Beyond the clamp the cap goes on along its slope. The cap is convex, so from the height of its pole the steps
    converge on the first crossing.
    """
    scale = 1.0 / (radius * radius)
    x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
    q = (x * x + y * y) * scale
    height, slope = _polynomial(shape[1:16], min(q, 1.0))
    return (z - height - slope * max(q - 1.0, 0.0)) / (dz - 2.0 * scale * slope * (x * dx + y * dy))


@njit(inline="always")
def membrane_at(t, step, ox, oy, oz, dx, dy, dz, radius, ring, shape):
    """What a ray (membrane frame, mm) meets, given the converged t and the last step.

    Returns (what, u, v, x, y, z, nx, ny, nz): what 1 membrane, 2 clamping ring, 0 neither; (u, v) the material
    point; the place; the outward normal.
    """
    scale = 1.0 / (radius * radius)
    x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
    q = (x * x + y * y) * scale
    on_membrane = (abs(step) < 1e-7) & (q <= 1.0) & (dz < 0.0)
    flat = -oz / dz
    fx, fy = ox + flat * dx, oy + flat * dy
    fq = (fx * fx + fy * fy) * scale
    on_ring = (fq > 1.0) & (fq <= (1.0 + ring / radius) ** 2) & (dz < 0.0)
    _, slope = _polynomial(shape[1:16], min(q, 1.0))
    ratio, _ = _polynomial(shape[16:31], min(q, 1.0))
    what = 1.0 if on_membrane else (2.0 if on_ring else 0.0)
    x, y, z = x if on_membrane else fx, y if on_membrane else fy, z if on_membrane else 0.0
    ratio = ratio if on_membrane else 1.0
    tilt = -2.0 * scale * slope if on_membrane else 0.0
    nz = 1.0 / np.sqrt(1.0 + tilt * tilt * (x * x + y * y))
    return what, x * ratio, y * ratio, x, y, z, tilt * x * nz, tilt * y * nz, nz
