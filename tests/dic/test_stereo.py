"""Two views of one surface, matched from nothing but the curves on which the points must lie."""

import numpy as np
import pytest

from bscd.dic import prepare
from bscd.dic.stereo import match_views
from tests.dic.motions import Affine
from tests.dic.speckle_pairs import Speckle, digitise

SIZE = (360, 200)
CENTRE = (120.0, 100.0)
#: 100 px of disparity in the middle, changing by 0.1 a column and a little by row: a tilted surface.
DISPARITY = Affine(((1.1, 0.02), (0.0, 1.0)), shift_px=(100.0, 0.8), centre_px=CENTRE)
DEPTHS = np.linspace(-1.0, 1.0, 41)
SPECKLE = Speckle(seed=3, size_px=SIZE)
POINTS = np.stack(np.meshgrid(np.arange(30.0, 220.0, 10.0), np.arange(20.0, 181.0, 10.0)), axis=-1).reshape(-1, 2)


def curve(points_px):
    """Disparities of 20 to 180 px at the point's own gradient, and 3 px off the true row: a rough calibration."""
    places = points_px + DISPARITY.displacement_px(points_px) + [0.0, 3.0]
    return places[:, None, :] + np.stack([80.0 * DEPTHS, 4.0 * DEPTHS], axis=1)


def views(right=DISPARITY, noise_grey=2.0, other=SPECKLE):
    left = digitise(SPECKLE.image(), noise_grey, np.random.default_rng(1))
    return tuple(prepare(image) for image in (left, digitise(other.image(right), noise_grey, np.random.default_rng(2))))


def test_a_large_disparity_is_found_without_a_seed():
    left, right = views()
    found = match_views(left, right, POINTS, curve, noise_grey=2.0)
    truth = DISPARITY.displacement_px(POINTS)
    assert np.ptp(truth[:, 0]) > 15.0
    assert found.valid.all()
    error = found.displacement_px - truth
    assert np.sqrt(np.mean(error**2)) < 0.015
    assert 0.6 < np.mean(np.abs(error) < found.sigma_px) < 0.76
    assert np.abs(np.median(found.gradient, axis=0) - [[0.1, 0.02], [0.0, 0.0]]).max() < 2e-3


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
def test_shape_functions(shape):
    left, right = views()
    found = match_views(left, right, POINTS, curve, shape=shape, noise_grey=2.0)
    assert found.shape.shape[1] == {"affine": 6, "quadratic": 12}[shape]
    assert found.valid.mean() > 0.98


def test_views_with_nothing_in_common():
    left, right = views(other=Speckle(seed=99, size_px=SIZE))
    found = match_views(left, right, POINTS, curve, noise_grey=2.0)
    assert not found.valid.any()
    assert np.isnan(found.displacement_px).all()


def test_an_empty_right_view():
    left, _ = views()
    empty = digitise(np.full(SIZE[::-1], 120.0), 2.0, np.random.default_rng(3))
    assert not match_views(left, prepare(empty), POINTS, curve, noise_grey=2.0).valid.any()


def test_only_what_both_views_show_is_matched():
    left, right = views()
    covered = np.asarray(right.grey).copy()
    covered[:, :180] = 25
    found = match_views(left, prepare(covered), POINTS, curve, noise_grey=2.0)
    place = POINTS + DISPARITY.displacement_px(POINTS)
    assert not found.valid[place[:, 0] < 168.0].any()
    assert found.valid[place[:, 0] > 195.0].mean() > 0.98


def test_a_curve_that_misses_the_surface_finds_nothing():
    left, right = views()
    found = match_views(left, right, POINTS, lambda points: curve(points) + [0.0, 40.0], noise_grey=2.0)
    assert not found.valid.any()


def test_points_whose_curve_is_unknown_follow_their_neighbours():
    def partly(points_px):
        places = curve(points_px)
        places[points_px[:, 1] > 100.0] = np.nan
        places[:, :5] = np.nan
        return places

    left, right = views()
    assert match_views(left, right, POINTS, partly, noise_grey=2.0).valid.all()


def test_curves_that_leave_the_image():
    left, right = views()
    found = match_views(left, right, POINTS, lambda points: curve(points) + [5000.0, 0.0], noise_grey=2.0)
    assert not found.valid.any()
    away = match_views(left, right, POINTS, lambda points: curve(points) - [5000.0, 0.0], noise_grey=2.0)
    assert not away.valid.any()


def test_no_points():
    left, right = views()
    assert len(match_views(left, right, np.zeros((0, 2)), curve).valid) == 0


def test_the_number_of_threads_changes_nothing():
    left, right = views()
    one, two = (match_views(left, right, POINTS, curve, noise_grey=2.0, threads=n) for n in (1, 2))
    assert np.array_equal(one.displacement_px, two.displacement_px, equal_nan=True)
