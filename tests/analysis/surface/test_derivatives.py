"""The local fits' kernels beside plain numpy: least squares on monomials, dense noise matrices."""

import numpy as np
import pytest

from bscd.analysis.surface.neighbourhoods import Neighbourhoods
from bscd.analysis.surface.spacing import point_spacing, surface_scale
from tests.analysis.surface.shapes import grid

HALF_PX = 20.0


def scattered(seed=1):
    """Irregular points, some of them not measured."""
    rng = np.random.default_rng(seed)
    points, _ = grid(8)
    return points + rng.uniform(-2.0, 2.0, points.shape), rng.random(len(points)) > 0.1


def plain_weights(points, valid, row, order):
    """Weights ``(2, N)`` of d/dcolumn, d/drow at a point: rows of the pseudo-inverse of the monomials there."""
    near = np.flatnonzero((np.abs(points - points[row]).max(axis=1) <= HALF_PX) & valid)
    x, y = (points[near] - points[row]).T
    powers = [(0, 0), (1, 0), (0, 1)] + [(n - k, k) for n in range(2, order + 1) for k in range(n + 1)]
    weights = np.zeros((2, len(points)))
    weights[:, near] = np.linalg.pinv(np.stack([x**i * y**j for i, j in powers], axis=1))[1:3]
    return weights


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_derivatives_are_those_of_least_squares(order):
    points, valid = scattered()
    near = Neighbourhoods.of(points, HALF_PX)
    rows = np.flatnonzero(valid)
    fits = near.fit(rows, valid, order, 5 - order)
    values = np.random.default_rng(2).normal(size=(len(points), 3))
    values[~valid] = 0.0
    found = np.full((len(points), 3, 4), np.nan)
    near.derivatives(fits, values, found)
    for row in rows[:: len(rows) // 20]:
        weights = np.vstack([plain_weights(points, valid, row, degree) for degree in (order, 5 - order)])
        np.testing.assert_allclose(found[row], (weights @ values).T, atol=1e-10)
    assert np.isnan(found[~valid]).all()
    inside = (np.abs(points - points[rows, None]).max(axis=2) <= HALF_PX) & valid
    np.testing.assert_array_equal(fits.count, inside.sum(axis=1))
    centre = np.array([points[near].mean(axis=0) for near in inside])
    np.testing.assert_allclose(fits.offset, np.abs(centre - points[rows]).max(axis=1) / HALF_PX, atol=1e-12)


@pytest.mark.parametrize("orders", [(3, 2), (2, 4)])
@pytest.mark.parametrize("lost", [0.02, 0.3, 0.7])
def test_fits_without_some_points_are_the_same_from_the_complete_ones(orders, lost):
    points, _ = scattered()
    near, everywhere = Neighbourhoods.of(points, HALF_PX), np.ones(len(points), bool)
    complete = near.fit(np.arange(len(points)), everywhere, *orders)
    valid = np.random.default_rng(6).uniform(size=len(points)) >= lost
    rows = np.flatnonzero(valid)
    values = np.where(valid[:, None], np.random.default_rng(7).normal(size=(len(points), 3)), 0.0)
    anew, from_complete = np.full((2, len(points), 3, 4), np.nan)
    near.derivatives(near.fit(rows, valid, *orders), values, anew)
    near.derivatives(near.fit(rows, valid, *orders, complete), values, from_complete)
    np.testing.assert_allclose(from_complete, anew, atol=1e-11)


@pytest.mark.parametrize("subset_px", [21.0, 0.0])
def test_noise_passes_as_through_the_dense_matrices(subset_px):
    points, valid = scattered()
    near = Neighbourhoods.of(points, HALF_PX)
    rows = np.flatnonzero(valid)[:60]
    fits = near.fit(rows, valid, 3, 2)
    found = near.noise(fits, subset_px)
    apart = np.abs(points[:, None] - points)
    shared = np.prod(np.clip(1.0 - apart / subset_px, 0.0, None), axis=2) if subset_px else np.eye(len(points))
    variance = np.random.default_rng(3).uniform(0.5, 2.0, (len(points), 3))
    mean = np.full((len(points), 3), np.nan)
    near.local_mean(fits, variance, mean)
    for row in rows[::7]:
        weights = np.vstack([plain_weights(points, valid, row, degree) for degree in (3, 2)])
        np.testing.assert_allclose(found[row], weights @ shared @ weights.T, atol=1e-12)
        np.testing.assert_allclose(near.squares(fits)[row], np.sum(weights**2, axis=1), atol=1e-12)
        share = np.sum(weights[:2] ** 2, axis=0)
        np.testing.assert_allclose(mean[row], share @ variance / share.sum(), rtol=1e-12)


def test_windows_that_look_alike_share_their_weights():
    points, _ = grid(15)
    near = Neighbourhoods.of(points, HALF_PX)
    everywhere = np.ones(len(points), bool)
    fits = near.fit(np.arange(len(points)), everywhere, 3, 2)
    assert len(np.unique(fits.start)) < 300  # of 961, most of them whole
    assert len(fits.table) < 0.3 * len(near.indices)
    alone = [near.fit(np.array([row]), everywhere, 3, 2) for row in (0, 480, 481)]
    values = np.random.default_rng(4).normal(size=(len(points), 3))
    together, single = np.empty((len(points), 3, 4)), np.empty((len(points), 3, 4))
    near.derivatives(fits, values, together)
    for one in alone:
        near.derivatives(one, values, single)
    np.testing.assert_allclose(single[[0, 480, 481]], together[[0, 480, 481]], atol=1e-12)


def test_points_on_a_line_have_no_fit():
    points = np.stack([np.arange(40.0), np.zeros(40)], axis=1)
    fits = Neighbourhoods.of(points, 10.0).fit(np.arange(40), np.ones(40, bool), 1, 1)
    assert np.all(fits.start == -1)


@pytest.mark.parametrize("step_px", [3.0, 10.0])
def test_spacing_and_scale_come_from_the_points(step_px):
    points_px, xyz_mm = grid(10, step_px)
    gone = np.hypot(*(points_px - 4.0 * step_px).T) < 2.5 * step_px
    assert point_spacing(points_px[~gone]) == pytest.approx(step_px, rel=1e-9)
    assert surface_scale(points_px[~gone], xyz_mm[~gone]) == pytest.approx(0.0554, rel=1e-9)
    irregular = np.random.default_rng(5).uniform(0.0, 30.0 * step_px, (900, 2))
    assert point_spacing(irregular) == pytest.approx(step_px, rel=0.25)
