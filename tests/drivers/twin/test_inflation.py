"""The membrane's mechanics against what the shooting does not use: least energy, local balance, Hencky's series."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from drivers.twin.inflation import STEPS, load_for_rise, solve, tensions
from drivers.twin.membrane import Membrane
from drivers.twin.options import MembraneOptions

MEMBRANE = Membrane(MembraneOptions())


def _ritz_rise(load, terms=7):
    """Rise of the pole that minimises strain energy minus pressure work over polynomial shapes (no balance used)."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    s, weights = (nodes + 1.0) / 2.0, weights / 2.0
    k = np.arange(terms)[:, None]
    odd = s ** (2 * k + 1) * (1.0 - s**2)
    odd_slope = (2 * k + 1) * s ** (2 * k) - (2 * k + 3) * s ** (2 * k + 2)
    even_slope = 2 * k * s ** np.maximum(2 * k - 1, 0) - (2 * k + 2) * s ** (2 * k + 1)

    def energy(c):
        radius, radius_slope = s + c[:terms] @ odd, 1.0 + c[:terms] @ odd_slope
        height_slope = c[terms:] @ even_slope
        radial2, hoop2 = radius_slope**2 + height_slope**2, (radius / s) ** 2
        strain = (radial2 + hoop2 + 1.0 / (radial2 * hoop2) - 3.0) * s  # mu/2 (I1 - 3) 2 pi R, over pi mu
        return weights @ strain - load * (weights @ (-height_slope * radius**2))

    start = np.zeros(2 * terms)
    start[terms] = 0.3
    best = minimize(energy, start, method="BFGS", options={"gtol": 1e-9, "maxiter": 2000})
    return float(best.x[terms:] @ (np.arange(terms) == 0))


@pytest.mark.parametrize("pressure_kpa", [1.0, 13.0, 16.0])
def test_the_shape_is_that_of_least_energy(pressure_kpa):
    load = pressure_kpa * MEMBRANE.load_per_kpa
    assert _ritz_rise(load) == pytest.approx(solve(load).height[0], rel=2e-5)


@pytest.mark.parametrize("pressure_kpa", [0.05, 5.0, 13.0])
def test_pressure_is_borne_by_curvature_and_tension_everywhere(pressure_kpa):
    """Laplace's equation K1 T1 + K2 T2 = p with curvatures taken from the shape by finite differences."""
    load = pressure_kpa * MEMBRANE.load_per_kpa
    shape = solve(load)
    r1, z1 = np.gradient(shape.radius, shape.material), np.gradient(shape.height, shape.material)
    r2, z2 = np.gradient(r1, shape.material), np.gradient(z1, shape.material)
    speed = np.hypot(r1, z1)
    meridional = -(r1 * z2 - z1 * r2) / speed**3
    inner = slice(STEPS // 10, -STEPS // 50)
    hoop = -z1[inner] / speed[inner] / shape.radius[inner]
    along, around = np.array(
        [tensions(a, b) for a, b in zip(shape.radial_stretch[inner], shape.hoop_stretch[inner], strict=True)]
    ).T
    np.testing.assert_allclose(meridional[inner] * along + hoop * around, load, rtol=2e-4)


def _hencky_rise():
    """Rise of a shallow linear-elastic membrane, nu = 1/2, over a (p a / (E H))^(1/3): Hencky's series (1915)."""
    b_tail = [(1, 2), (2 / 3, 5), (13 / 18, 8), (17 / 18, 11), (37 / 27, 14), (1205 / 567, 17), (219241 / 63504, 20)]
    a_tail = [(1, 1), (1 / 2, 4), (5 / 9, 7), (55 / 72, 10), (7 / 6, 13), (205 / 108, 16), (17051 / 5292, 19)]

    def clamped(b0):
        hoop_strain = [b0] + [-factor / b0**power for factor, power in b_tail]
        return sum((2 * n + 1 - 0.5) * b for n, b in enumerate(hoop_strain))

    b0 = brentq(clamped, 1.4, 2.5)
    return sum(factor / b0**power for factor, power in a_tail)


def test_a_shallow_cap_rises_with_the_cube_root_of_the_pressure_as_hencky_has_it():
    for load in (1e-6, 1e-5):
        young_load = load / 3.0  # E = 3 mu
        assert solve(load).height[0] == pytest.approx(_hencky_rise() * young_load ** (1 / 3), rel=4e-3)
    ratio = solve(8e-6).height[0] / solve(1e-6).height[0]
    assert ratio == pytest.approx(2.0, rel=1e-3)


def test_the_pole_rises_six_millimetres_at_thirteen_kilopascals():
    assert MEMBRANE.rise_mm(13.0) == pytest.approx(6.0, abs=1e-10)
    assert load_for_rise(0.4) / 13.0 == pytest.approx(MEMBRANE.load_per_kpa)
    pressures = np.linspace(0.0, 16.0, 33)
    rises = [MEMBRANE.rise_mm(p) for p in pressures]
    assert rises[0] == 0.0
    assert np.all(np.diff(rises) > 0.0)


def test_the_clamp_stays_and_the_pole_is_on_the_axis():
    phi = np.linspace(0.0, 6.0, 7)
    rim = MEMBRANE.positions(np.stack([np.full(7, 15.0), phi], axis=-1), 13.0)
    np.testing.assert_allclose(rim, 15.0 * np.stack([np.cos(phi), np.sin(phi), 0 * phi], axis=-1), atol=1e-9)
    np.testing.assert_allclose(MEMBRANE.positions([[0.0, 1.0]], 13.0), [[0.0, 0.0, 6.0]], atol=1e-9)


def test_strains_are_those_of_the_positions():
    radius, step = np.array([1.0, 6.0, 11.0, 14.0]), 1e-4
    at = [MEMBRANE.positions(np.stack([radius + d, 0 * radius], axis=-1), 13.0) for d in (-step, 0.0, step)]
    radial = np.linalg.norm(at[2] - at[0], axis=1) / (2 * step)
    hoop = at[1][:, 0] / radius
    strain = MEMBRANE.green_lagrange(np.stack([radius, 0 * radius], axis=-1), 13.0)
    np.testing.assert_allclose(strain, (np.stack([radial, hoop], axis=-1) ** 2 - 1.0) / 2.0, atol=1e-7)


def test_what_the_membrane_can_not_bear_is_refused():
    with pytest.raises(ValueError, match="60 kPa is more than the twin's membrane can bear"):
        MEMBRANE.meridian(60.0)
    with pytest.raises(ValueError, match="material radii"):
        MEMBRANE.positions([[15.5, 0.0]], 13.0)
