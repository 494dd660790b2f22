"""The sphere fit on analytic spheres: exact, robust, and as uncertain as it says."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from bscd.analysis.surface import fit_sphere, radial_deviation
from bscd.errors import InputError
from tests.analysis.surface.shapes import cap, turned

RADIUS, CENTRE = 18.265, np.array([0.6, 13.0, 0.5])
BALL_DEG = 40.0  # the part of the ball that both halves see


@pytest.mark.parametrize("robust", [True, False])
@pytest.mark.parametrize("radius_mm", [None, RADIUS])
@pytest.mark.parametrize("half_deg", [8.0, BALL_DEG, 180.0])
def test_exact_points_give_the_sphere_exactly(half_deg, radius_mm, robust):
    points, _ = cap(400, half_deg, np.random.default_rng(1))
    points[[3, 50]] = np.nan
    fit = fit_sphere(points, radius_mm=radius_mm, robust=robust)
    np.testing.assert_allclose(fit.centre_mm, CENTRE, atol=1e-8)
    assert fit.radius_mm == pytest.approx(RADIUS, abs=1e-8)
    assert np.isnan(fit.deviation_mm[[3, 50]]).all()
    assert not fit.used[[3, 50]].any()
    assert fit.used.sum() == 398
    assert np.nanmax(np.abs(fit.deviation_mm)) < 1e-8


def test_the_plain_fit_is_the_minimum_of_squared_radial_deviations():
    rng = np.random.default_rng(2)
    points, normals = cap(200, 25.0, rng)
    points = points + 0.05 * normals * rng.normal(size=(200, 1))
    found = least_squares(lambda p: np.linalg.norm(points - p[:3], axis=1) - p[3], [0, 12, 0, 17], xtol=1e-15)
    fit = fit_sphere(points, robust=False)
    np.testing.assert_allclose([*fit.centre_mm, fit.radius_mm], found.x, atol=1e-6)
    cov = np.linalg.inv(found.jac.T @ found.jac) * 2.0 * found.cost / (200 - 4)
    np.testing.assert_allclose(fit.covariance_mm2, cov, rtol=1e-4, atol=1e-9)
    assert fit.std_mm == pytest.approx(np.std(found.fun), rel=1e-9)


@pytest.mark.parametrize("radius_mm", [None, RADIUS])
def test_a_fifth_of_gross_outliers_moves_nothing(radius_mm):
    """All to one side, so that least squares is dragged millimetres off; the good ones alone are the measure."""
    rng = np.random.default_rng(3)
    points, normals = cap(1000, BALL_DEG, rng)
    points = points + 0.01 * rng.normal(size=points.shape)
    bad = rng.permutation(np.flatnonzero(points[:, 0] > CENTRE[0]))[:200]
    spoilt = points.copy()
    spoilt[bad] += rng.uniform(0.3, 6.0, size=(200, 1)) * normals[bad]
    good = fit_sphere(np.delete(points, bad, axis=0), radius_mm=radius_mm)
    fit = fit_sphere(spoilt, radius_mm=radius_mm)
    assert not fit.used[bad].any()
    assert np.all(np.abs(fit.centre_mm - good.centre_mm) < 0.3 * good.centre_sigma_mm)
    assert abs(fit.radius_mm - good.radius_mm) <= 0.3 * good.radius_sigma_mm
    assert fit.std_mm == pytest.approx(0.01, rel=0.1)
    plain = fit_sphere(spoilt, radius_mm=radius_mm, robust=False)
    assert np.linalg.norm(plain.centre_mm - CENTRE) > 0.1


@pytest.mark.parametrize("given_sigma", [True, False])
def test_two_thirds_of_the_spheres_lie_within_their_uncertainty(given_sigma):
    rng = np.random.default_rng(4)
    within = []
    for _ in range(80):
        points, normals = cap(200, BALL_DEG, rng)
        sigma = rng.uniform(0.004, 0.02, 200) if given_sigma else np.full(200, 0.01)
        points = points + normals * (sigma * rng.normal(size=200))[:, None]
        fit = fit_sphere(points, sigma_mm=sigma if given_sigma else None)
        expected = 1.0 if given_sigma else 0.01
        assert fit.scale == pytest.approx(expected, rel=0.25)
        off = np.abs([*(fit.centre_mm - CENTRE), fit.radius_mm - RADIUS])
        within.append(off < [*fit.centre_sigma_mm, fit.radius_sigma_mm])
    assert np.mean(within) == pytest.approx(0.683, abs=0.06)


def test_sigma_along_the_normal_is_what_weighs():
    """Depth noise that the given sigma knows: the fit that knows it is better, and equals that of radial sigmas."""
    rng = np.random.default_rng(5)
    points, normals = cap(600, 60.0, rng)
    sigma = np.tile([0.001, 0.03, 0.001], (600, 1))
    noisy = points + sigma * rng.normal(size=points.shape)
    fit = fit_sphere(noisy, sigma_mm=sigma)
    radial = fit_sphere(noisy, sigma_mm=np.sqrt(np.sum((sigma * normals) ** 2, axis=1)))
    np.testing.assert_allclose(fit.centre_mm, radial.centre_mm, atol=0.2 * radial.centre_sigma_mm.min())
    assert np.linalg.norm(fit.centre_mm - CENTRE) < np.linalg.norm(fit_sphere(noisy).centre_mm - CENTRE)


def test_a_fixed_radius_shows_the_bias_of_the_points():
    _, normals = cap(250, 180.0, np.random.default_rng(6))
    points = CENTRE + RADIUS * np.vstack([normals, -normals])
    fit = fit_sphere(CENTRE + (RADIUS + 0.3) * np.vstack([normals, -normals]), radius_mm=RADIUS)
    assert fit.radius_mm == pytest.approx(RADIUS)
    assert fit.radius_sigma_mm == 0.0
    assert fit.mean_mm == pytest.approx(0.3, abs=1e-9)
    np.testing.assert_allclose(radial_deviation(points, CENTRE, RADIUS), 0.0, atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(
    st.tuples(*[st.floats(-180.0, 180.0)] * 3),
    st.tuples(*[st.floats(-500.0, 500.0)] * 3),
    st.floats(0.1, 10.0),
)
def test_the_fit_moves_turns_and_grows_with_its_points(turn_deg, shift_mm, size):
    rng = np.random.default_rng(7)
    points, normals = cap(60, 50.0, rng)
    points = points + normals * 0.02 * rng.normal(size=(60, 1))
    first = fit_sphere(points)
    rotation = turned(turn_deg)
    moved = fit_sphere(size * points @ rotation.T + shift_mm)
    np.testing.assert_allclose(moved.centre_mm, size * rotation @ first.centre_mm + shift_mm, atol=1e-6)
    assert moved.radius_mm == pytest.approx(size * first.radius_mm, abs=1e-6)
    np.testing.assert_allclose(moved.deviation_mm, size * first.deviation_mm, atol=1e-6)


FLAT = np.column_stack([np.random.default_rng(8).normal(size=(50, 2)), np.zeros(50)])
LINE = np.outer(np.linspace(0.0, 1.0, 50), [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("points", "options", "says"),
    [
        (np.zeros((50, 2)), {}, "points \\(N, 3\\)"),
        (cap(11, 40.0, np.random.default_rng(9))[0], {}, "at least 12 points; 11 are known"),
        (np.full((50, 3), np.nan), {}, "0 are known"),
        (cap(3, 40.0, np.random.default_rng(9))[0], {"radius_mm": 18.0, "robust": False}, "at least 4 points"),
        (FLAT, {}, "on a plane"),
        (FLAT, {"radius_mm": 18.0}, "on a plane"),
        (FLAT + 1e-3 * np.random.default_rng(1).normal(size=(50, 3)), {}, "flat within their scatter"),
        (FLAT + 1e-3 * np.random.default_rng(1).normal(size=(50, 3)), {"radius_mm": 9.0}, "flat within their scatter"),
        (LINE, {}, "on a line"),
        (np.ones((50, 3)), {}, "on a line"),
        (cap(50, 40.0, np.random.default_rng(9))[0], {"radius_mm": -1.0}, "positive number"),
        (cap(50, 40.0, np.random.default_rng(9))[0], {"sigma_mm": np.zeros(50)}, "must be positive"),
        (cap(50, 40.0, np.random.default_rng(9))[0], {"sigma_mm": np.ones(49)}, "shape"),
    ],
)
def test_what_has_no_sphere_is_refused(points, options, says):
    with pytest.raises(InputError, match=says):
        fit_sphere(points, **options)
