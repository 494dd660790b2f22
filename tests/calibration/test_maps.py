import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from bscd.calibration.hull import Hull
from bscd.calibration.maps import LinearMap, fit_smooth_map
from bscd.errors import InputError

RNG = np.random.default_rng(7)
POINTS = RNG.uniform([-8, -12, -22], [8, 20, 22], (2000, 3))
ELSEWHERE = RNG.uniform([-6, -10, -20], [6, 18, 20], (500, 3))


def quartic(points):
    x, y, z = points.T / 10.0
    return np.stack([1 + x * y * z**2 - z**4, x**3 * y, y**4 + 0.2 * x, x * z + x**2 * y**2], axis=1)


def test_smooth_map_reproduces_a_polynomial_of_its_degree():
    fitted = fit_smooth_map(POINTS, quartic(POINTS), 4)
    assert np.abs(fitted.shifts_px(ELSEWHERE) - quartic(ELSEWHERE)).max() < 1e-9


def test_smooth_map_covariance_is_the_scatter_and_grows_outside():
    fits = [fit_smooth_map(POINTS, quartic(POINTS) + RNG.normal(0, 0.1, (2000, 4)), 4) for _ in range(200)]
    scatter = np.var([fit.shifts_px(ELSEWHERE) for fit in fits], axis=0)
    reported = np.diagonal(fits[0].covariance_px2(ELSEWHERE), axis1=1, axis2=2)
    assert np.allclose((scatter / reported).mean(axis=0), 1.0, atol=0.1)
    outside = np.array([[0.0, 60.0, 0.0]])
    assert fits[0].covariance_px2(outside)[0, 0, 0] > 100 * reported[:, 0].max()


def test_linear_map_is_griddata():
    shifts = quartic(POINTS)
    smooth = fit_smooth_map(POINTS, shifts, 2)
    mine = LinearMap(Delaunay(POINTS), shifts, smooth)
    within = ELSEWHERE * 0.75  # away from the hull's slivers
    assert np.abs(mine.shifts_px(within) - LinearNDInterpolator(POINTS, shifts)(within)).max() < 1e-9
    outside = ELSEWHERE + [30.0, 0.0, 0.0]
    assert np.array_equal(mine.shifts_px(outside), smooth.shifts_px(outside))


def test_linear_map_is_local_up_to_the_hull():
    """A nearly regular grid's hull is covered by slivers from end to end; they must not be used."""
    grid = np.stack(np.meshgrid(np.arange(-8, 9, 2.0), np.arange(-16, 17, 2.0), np.arange(-22, 23, 2.0)), -1)
    points = grid.reshape(-1, 3) + RNG.normal(0, 2e-3, (grid.size // 3, 3))
    mine = LinearMap(Delaunay(points), quartic(points), fit_smooth_map(points, quartic(points), 4))
    at = RNG.uniform([-8, -16, -22], [8, 16, 22], (20000, 3))
    at[:10000, 0] = np.sign(at[:10000, 0]) * (8.0 - RNG.uniform(0.0, 6e-3, 10000))
    error = np.abs(mine.shifts_px(at) - quartic(at)).max(axis=1)
    local = 0.5 * 2.0**2 * 3 * 0.9  # half the squared spacing times the largest second derivatives, px
    assert error.max() < local


def test_too_few_positions_for_the_degree():
    flat = POINTS * [1, 0, 1] + [0, 1, 0] * RNG.integers(0, 3, (2000, 1))
    with pytest.raises(InputError, match="do not determine degree 4"):
        fit_smooth_map(flat, quartic(flat), 4)


def test_hull_is_that_of_the_points():
    hull = Hull.around(POINTS)
    assert hull.contains(POINTS).all()
    inside = Delaunay(POINTS).find_simplex(ELSEWHERE * 1.4) >= 0
    assert 0.1 < inside.mean() < 0.95
    assert np.array_equal(hull.contains(ELSEWHERE * 1.4), inside)
    assert not hull.contains(np.array([[np.nan, 0, 0], [1e9, 0, 0]])).any()
