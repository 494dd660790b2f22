"""Second derivatives and scatter of fields that are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from bscd.dic import correlate, prepare
from bscd.dic.curvature import SECOND, Curvature, follow_curvature
from tests.dic.motions import FloatArray, bend
from tests.dic.speckle_pairs import Speckle

SUBSET = 21
SECONDS = np.array([3e-4, -1e-4, 2e-4, -4e-4, 5e-5, 1e-4])


def grid(step: float, columns: int = 20, rows: int = 16) -> FloatArray:
    return np.stack(np.meshgrid(np.arange(columns) * step, np.arange(rows) * step), axis=-1).reshape(-1, 2)


def quadratic(points: FloatArray) -> FloatArray:
    x, y = points.T
    terms = np.stack([x * x / 2.0, x * y, y * y / 2.0], axis=1)
    return np.stack([0.3 + 0.01 * x + terms @ SECONDS[:3], -0.2 + 0.02 * y + terms @ SECONDS[3:]], axis=1)


class TestSecondDerivatives:
    @pytest.mark.parametrize("step", [2.0, 5.0, 10.0, 40.0])
    def test_of_a_second_order_field_are_exact(self, step):
        points = grid(step)
        found = Curvature(points, SUBSET).second_derivatives(quadratic(points))
        np.testing.assert_allclose(found, np.tile(SECONDS, (len(points), 1)), rtol=1e-4, atol=1e-8)

    def test_points_that_are_not_known_have_no_say(self):
        points, rng = grid(10.0), np.random.default_rng(2)
        values, fit = quadratic(points), Curvature(points, SUBSET)
        for share in (0.3, 0.1, 0.3):
            holed = np.where(rng.random(len(points))[:, None] < share, np.nan, values)
            np.testing.assert_allclose(
                fit.second_derivatives(holed), np.tile(SECONDS, (len(points), 1)), rtol=1e-4, atol=1e-8
            )

    def test_a_point_alone_has_those_of_its_nearest_neighbours(self):
        points = np.vstack([grid(10.0), [[500.0, 80.0]]])
        found = Curvature(points, SUBSET).second_derivatives(quadratic(points))
        np.testing.assert_allclose(found[-1], SECONDS, rtol=1e-4)

    @pytest.mark.parametrize("points", [np.zeros((0, 2)), np.zeros((1, 2)), grid(10.0, 2, 2)])
    def test_too_few_points_are_flat(self, points):
        found = Curvature(points, SUBSET).second_derivatives(quadratic(points))
        assert found.shape == (len(points), 6)
        np.testing.assert_array_equal(found, 0.0)

    def test_points_in_a_row_bend_along_it_only(self):
        points = grid(10.0, 30, 1)
        found = Curvature(points, SUBSET).second_derivatives(quadratic(points))
        along = SECONDS * [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]
        np.testing.assert_allclose(found, np.tile(along, (len(points), 1)), rtol=1e-4, atol=1e-8)

    def test_nothing_known_is_flat(self):
        points = grid(10.0)
        fit = Curvature(points, SUBSET)
        fit.second_derivatives(quadratic(points))
        np.testing.assert_array_equal(fit.second_derivatives(np.full((len(points), 2), np.nan)), 0.0)

    def test_their_bias_is_what_a_subset_misses(self):
        fit = Curvature(grid(10.0), SUBSET)
        square = np.mean(np.arange(-10, 11) ** 2)
        np.testing.assert_allclose(fit.bias_px(np.array([[2e-3, 0, 0, 0, 0, -4e-3]])), [[1e-3 * square, 2e-3 * square]])


def overlapping_noise(points: FloatArray, covariance: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Noise that the points' subsets share as far as they overlap: means over squares of white noise."""
    white = rng.normal(size=(2, *(points.max(axis=0)[::-1].astype(int) + SUBSET)))
    sums = np.zeros((2, white.shape[1] + 1, white.shape[2] + 1))
    sums[:, 1:, 1:] = white.cumsum(axis=1).cumsum(axis=2)
    x, y = points.T.astype(int)
    square = sums[:, y + SUBSET, x + SUBSET] - sums[:, y, x + SUBSET] - sums[:, y + SUBSET, x] + sums[:, y, x]
    return (square / SUBSET).T @ np.linalg.cholesky(covariance).T


class TestScatter:
    COVARIANCE = np.array([[4e-5, 1e-5], [1e-5, 2e-5]])

    def scatter(self, step: float, times: float) -> FloatArray:
        """The mean over several fields."""
        points, rng = grid(step, 40, 40), np.random.default_rng(4)
        fit, known = Curvature(points, SUBSET), np.tile(self.COVARIANCE, (len(points), 1, 1))
        found = []
        for _ in range(6):
            noise = times * overlapping_noise(points, self.COVARIANCE, rng)
            found.append(fit.scatter(fit.residual_px(quadratic(points) + noise), known)[0])
        return np.mean(found)

    @pytest.mark.parametrize("step", [5.0, 10.0, 20.0, 30.0])
    def test_is_what_the_noise_is_more_than_it_should_be(self, step):
        assert self.scatter(step, 1.0) == pytest.approx(1.08, abs=0.08)  # at least 1 everywhere
        assert self.scatter(step, 1.5) == pytest.approx(1.5**2, rel=0.12)  # the largest residuals are cut

    def test_is_never_below_one(self):
        assert self.scatter(10.0, 0.3) == 1.0

    def test_a_single_wrong_point_does_not_make_its_neighbours_unsure(self):
        points, rng = grid(10.0, 30, 30), np.random.default_rng(5)
        values = quadratic(points) + overlapping_noise(points, self.COVARIANCE, rng)
        fit, known = Curvature(points, SUBSET), np.tile(self.COVARIANCE, (len(points), 1, 1))
        before, _ = fit.scatter(fit.residual_px(values), known)
        values[465] += 0.05  # ten sigma
        after, stray = fit.scatter(fit.residual_px(values), known)
        assert stray[465]
        assert stray.mean() < 0.005
        assert (after / before).max() < 1.6

    def test_points_that_are_not_known_count_for_nothing(self):
        points = grid(10.0)
        fit = Curvature(points, SUBSET)
        values = np.full((len(points), 2), np.nan)
        assert np.isnan(fit.residual_px(values)).all()
        covariance = np.full((len(points), 2, 2), np.nan)
        scatter, stray = fit.scatter(fit.residual_px(values), covariance)
        np.testing.assert_array_equal(scatter, 1.0)
        assert not stray.any()


def test_second_derivatives_that_make_matches_less_alike_are_not_taken():
    size = (200, 160)
    speckle = Speckle(seed=8, size_px=size)
    motion, points = bend(5e-4, size), grid(10.0, 14, 10) + 30.0
    first, second = (prepare(image) for image in speckle.pair(motion, 2.0, 8))
    flat = np.zeros((len(points), 12))
    flat[:, [0, 6]] = motion.displacement_px(points)
    found = correlate(first, second, points, guess_px=flat, shape="curved", noise_grey=2.0)
    fit = Curvature(points, SUBSET)
    followed, right = follow_curvature(first, second, points, found, fit, noise_grey=2.0)
    middle = (np.abs(points - [100.0, 80.0]) < 40.0).all(axis=1)
    np.testing.assert_allclose(np.median(right, axis=0)[[0, 3]], [5e-4, -2.5e-4], rtol=0.1)
    assert np.median(followed.zncc[middle] - found.zncc[middle]) > 0.0
    # a field that is not this one's
    wrong = lambda _: np.tile([-0.01, 0.0, -0.01, 0.0, 0.0, 0.0], (len(points), 1))  # noqa: E731
    fit.second_derivatives = wrong
    kept, second_order = follow_curvature(first, second, points, found, fit, noise_grey=2.0)
    np.testing.assert_array_equal(kept.displacement_px, found.displacement_px)
    np.testing.assert_array_equal(second_order, found.shape[:, SECOND])
