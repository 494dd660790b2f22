"""The curvature's kernels against the same in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from bscd.dic.curvature_kernel import fit_weights, half_squares, leftover, neighbour_sums, residuals, second_orders

RNG = np.random.default_rng(11)
POINTS, MOST, SUBSET = 60, 7, 21.0
COUNT = RNG.integers(0, MOST + 1, POINTS)
THERE = np.arange(MOST) < COUNT[:, None]
INDEX = np.where(THERE, RNG.integers(0, POINTS, (POINTS, MOST)), 0)
OFFSET = np.where(THERE[:, :, None], RNG.uniform(-30.0, 30.0, (POINTS, MOST, 2)), np.nan)
KNOWN = RNG.random(POINTS) < 0.8
WEIGHTS = np.where((THERE & KNOWN[INDEX])[:, None], RNG.normal(size=(POINTS, 6, MOST)), 0.0)


def test_fit_weights_are_those_of_least_squares():
    rng, count, radius, half_square = np.random.default_rng(12), np.array([12, 12, 9, 7, 3]), 30.0, 18.0
    points, most = len(count), 12
    index, known = rng.integers(0, points, (points, most)), np.array([True, True, False, True, True])
    offset = rng.uniform(-radius, radius, (points, most, 2))
    weights, noise = np.full((points, 6, most), np.nan), np.zeros(points)
    fit_weights(offset, index, count, known, np.arange(points - 1), radius, half_square, weights, noise)
    for n in range(points - 1):
        there = np.flatnonzero((np.arange(most) < count[n]) & known[index[n]])
        if len(there) <= 6:
            assert np.isinf(noise[n])
            continue
        x, y = offset[n, there].T
        exact = np.zeros((6, most))
        exact[:, there] = np.linalg.pinv(np.stack([np.ones_like(x), x, y, x * x / 2, x * y, y * y / 2], axis=1))
        scale = np.array([1.0, radius, radius, radius**2, radius**2, radius**2])[:, None]
        given = weights[n] * np.array([1.0, 1.0, 1.0, radius**2, radius**2, radius**2])[:, None]
        np.testing.assert_allclose(given, exact * scale, atol=1e-5 * np.abs(exact * scale).max())  # but for the ridge
        assert noise[n] == pytest.approx(half_square * np.sqrt(np.sum(exact[[3, 5]] ** 2)), rel=1e-4)
    assert np.isnan(weights[-1]).all()  # it was not asked for


def test_residuals():
    values, good = RNG.normal(size=(POINTS, 2)), RNG.random(POINTS) < 0.8
    values[~KNOWN] = np.nan
    found = np.empty((POINTS, 2))
    residuals(values, KNOWN, good, INDEX, WEIGHTS, found)
    fitted = np.einsum("nk,nkc->nc", WEIGHTS[:, 0], np.nan_to_num(values)[INDEX])
    expected = np.where((KNOWN & good)[:, None], values - fitted, np.nan)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_leftover_is_the_variance_of_what_the_fit_leaves():
    rows, found = np.flatnonzero(RNG.random(POINTS) < 0.7), np.full(POINTS, -1.0)
    leftover(OFFSET, COUNT, WEIGHTS, rows, SUBSET, found)
    for n in range(POINTS):
        if n not in rows:
            assert found[n] == -1.0
            continue
        # the point itself, and its neighbours with the weights of the fit, taken off
        at = np.vstack([[0.0, 0.0], OFFSET[n, : COUNT[n]]])
        share = np.append(1.0, -WEIGHTS[n, 0, : COUNT[n]])
        shared = np.prod(np.maximum(1.0 - np.abs(at[:, None] - at) / SUBSET, 0.0), axis=2)
        assert found[n] == pytest.approx(share @ shared @ share, rel=1e-12)


def test_half_squares():
    spread = RNG.normal(size=(POINTS, 2, 2))
    covariance, residual = spread @ np.swapaxes(spread, 1, 2) + 0.1 * np.eye(2), RNG.normal(size=(POINTS, 2))
    found = np.empty(POINTS)
    half_squares(residual, covariance, KNOWN, found)
    solved = np.linalg.solve(covariance, residual[:, :, None])[:, :, 0]
    np.testing.assert_allclose(found, np.where(KNOWN, np.sum(residual * solved, axis=1) / 2.0, 0.0), rtol=1e-10)


def test_neighbour_sums():
    values = RNG.normal(size=POINTS)
    once = np.sum(np.where(THERE, values[INDEX], 0.0), axis=1)
    np.testing.assert_allclose(neighbour_sums(values, INDEX, COUNT, 1), once, rtol=1e-12, atol=1e-12)
    twice = np.sum(np.where(THERE, once[INDEX], 0.0), axis=1)
    np.testing.assert_allclose(neighbour_sums(values, INDEX, COUNT, 2), twice, rtol=1e-12, atol=1e-12)


def test_second_orders():
    values, found = RNG.normal(size=(POINTS, 2)), np.empty((POINTS, 6))
    values[~KNOWN] = np.nan
    second_orders(values, KNOWN, INDEX, COUNT, WEIGHTS, found)
    expected = np.einsum("ntk,nkc->nct", WEIGHTS[:, 3:], np.nan_to_num(values)[INDEX]).reshape(POINTS, 6)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
