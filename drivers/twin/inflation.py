"""Inflation of a thin, flat, clamped circular membrane of incompressible neo-Hookean rubber.

The axisymmetric large-strain theory of Adkins and Rivlin (1952), in the form of Yang and Feng (1970), without
thin-cap or small-strain approximations. Everything is in units of the membrane's radius a and of mu H (shear
modulus times undeformed thickness), so the one load parameter is ``load`` = p a / (mu H).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.optimize import root_scalar

from drivers.twin.optics import FloatArray

#: Runge-Kutta steps from the pole to the clamp.
STEPS = 1000

#: Largest stretch at the pole that is looked at; the pressure's maximum comes later, near 1.9.
_LARGEST_STRETCH = 1.7


@dataclass(frozen=True)
class Meridian:
    """A solved shape at the material radii ``material`` ``(STEPS + 1,)``, in units of a.

    ``radius`` and ``height`` are the deformed place, ``radial_stretch`` and ``hoop_stretch`` the principal stretches,
    ``cos_slope`` the cosine of the meridian's slope.
    """

    load: float
    material: FloatArray
    radius: FloatArray
    height: FloatArray
    radial_stretch: FloatArray
    hoop_stretch: FloatArray
    cos_slope: FloatArray


@njit(cache=True)
def tensions(radial, hoop):
    """Tensions along meridian and hoop per deformed length over mu H: lambda_3 (lambda_i^2 - lambda_3^2)."""
    thin = 1.0 / (radial * hoop)
    return thin * (radial * radial - thin * thin), thin * (hoop * hoop - thin * thin)


@njit(cache=True)
def _slopes(s, radius, radial, load):
    """Derivatives of radius, height and radial stretch over the material radius s, and the cosine of the slope.

    Vertical balance of the cap, 2 pi r T1 sin = pi r^2 p, gives the slope; tangential balance,
    d(T1)/dr = (T2 - T1) / r, the stretch.
    """
    hoop = radius / s if s > 0.0 else radial
    along, around = tensions(radial, hoop)
    sine = load * radius / (2.0 * along)
    if not abs(sine) < 1.0:
        return np.nan, np.nan, np.nan, np.nan
    cosine = math.sqrt(1.0 - sine * sine)
    if s == 0.0:
        return radial, 0.0, 0.0, 1.0
    hoop_slope = (radial * cosine - hoop) / s
    by_radial = 1.0 / hoop + 3.0 / (radial**4 * hoop**3)
    by_hoop = -radial / hoop**2 + 3.0 / (radial**3 * hoop**4)
    change = (around - along) * cosine * radial / radius
    return radial * cosine, -radial * sine, (change - by_hoop * hoop_slope) / by_radial, cosine


@njit(cache=True)
def _shoot(stretch, load, radius, height, radial, cosine):
    """Classical Runge-Kutta from the pole (s = 0, equal stretches) to the clamp (s = 1); height is 0 at the pole."""
    steps = len(radius) - 1
    h = 1.0 / steps
    r, z, q = 0.0, 0.0, stretch
    for i in range(steps + 1):
        s = i * h
        r1, z1, q1, c = _slopes(s, r, q, load)
        radius[i], height[i], radial[i], cosine[i] = r, z, q, c
        if np.isnan(r1) or q < 1.0:  # too little stretch to bear the load: no shape, however it ends
            return np.nan
        if i == steps:
            break
        r2, z2, q2, _ = _slopes(s + h / 2, r + h / 2 * r1, q + h / 2 * q1, load)
        r3, z3, q3, _ = _slopes(s + h / 2, r + h / 2 * r2, q + h / 2 * q2, load)
        r4, z4, q4, _ = _slopes(s + h, r + h * r3, q + h * q3, load)
        r += h / 6 * (r1 + 2 * r2 + 2 * r3 + r4)
        z += h / 6 * (z1 + 2 * z2 + 2 * z3 + z4)
        q += h / 6 * (q1 + 2 * q2 + 2 * q3 + q4)
    return r


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """The root of a function that changes sign between two arguments."""
    result = root_scalar(function, method="brentq", bracket=(low, high), xtol=1e-15, rtol=1e-14)
    return float(result.root)


class _Shooter:
    """Shoots from the pole and keeps the arrays between shots."""

    def __init__(self) -> None:
        self.arrays = tuple(np.empty(STEPS + 1) for _ in range(4))

    def excess(self, stretch: float, load: float) -> float:
        """By how much the clamp's material point misses radius 1; a membrane that can not bear the load falls short."""
        radius = _shoot(stretch, load, *self.arrays)
        return -1.0 if math.isnan(radius) else radius - 1.0


def solve(load: float) -> Meridian:
    """The shape under a load p a / (mu H), on the rising branch. Raises `ValueError` beyond that branch."""
    material = np.linspace(0.0, 1.0, STEPS + 1)
    if load <= 0.0:
        ones = np.ones(STEPS + 1)
        return Meridian(0.0, material, material, np.zeros(STEPS + 1), ones, ones, ones)
    shooter = _Shooter()
    # from the flat sheet up: the first change of sign is the stable shape
    low = 1.0
    for high in 1.0 + np.geomspace(1e-7, _LARGEST_STRETCH - 1.0, 160):
        if shooter.excess(high, load) > 0.0:
            break
        low = float(high)
    else:
        raise ValueError(f"the membrane can not bear the load p a / (mu H) = {load:.3g}; lower the pressure")
    stretch = _root(lambda s: shooter.excess(s, load), low, float(high))
    shooter.excess(stretch, load)
    radius, height, radial, cosine = shooter.arrays
    hoop = np.divide(radius, material, out=np.full(STEPS + 1, stretch), where=material > 0.0)
    return Meridian(load, material, radius, height - height[-1], radial, hoop, cosine)


def load_for_rise(rise: float) -> float:
    """The load under which the pole rises by ``rise`` (over the radius)."""

    def excess(load: float) -> float:
        try:
            return solve(load).height[0] - rise
        except ValueError:
            return 1.0

    return _root(excess, 0.0, 4.0)
