"""What does not change a correlation, and why points fail."""

from __future__ import annotations

import numpy as np
import pytest

from bscd.dic import Status, correlate, prepare
from bscd.dic.solver import SolverOptions, solve
from tests.dic.exact_pairs import GROSS_PX, MOTIONS, NOISE, SIZE, off_px, pair, points, ring, same, seen
from tests.dic.motions import rotation, translation
from tests.dic.speckle_pairs import Speckle, digitise


@pytest.mark.parametrize("motion", [rotation(3.0, SIZE), translation(40.3, -22.0)], ids=["near", "far"])
@pytest.mark.parametrize("shape", ["affine", "quadratic"])
def test_threads_do_not_change_a_bit(motion, shape):
    places = points(4)
    assert len(places) > 3 * 512  # more than a thread takes at a time
    one, two, five = (correlate(*pair(motion), places, shape=shape, threads=threads) for threads in (1, 2, 5))
    same(one, two)
    same(one, five)


def test_the_order_of_points_hardly_matters():
    places = points(7)
    order = np.random.default_rng(5).permutation(len(places))
    straight, mixed = (correlate(*pair(MOTIONS["rotation"]), some) for some in (places, places[order]))
    np.testing.assert_array_equal(mixed.valid, straight.valid[order])
    # both have stopped within the tolerance
    np.testing.assert_allclose(mixed.displacement_px, straight.displacement_px[order], atol=5e-3)
    assert np.nanmedian(np.abs(mixed.displacement_px - straight.displacement_px[order])) < 1e-4


@pytest.mark.parametrize("interpolation", ["cubic", "quintic"])
def test_prepared_images_serve_again(interpolation):
    places, mask = points(9), ring()
    reference, current = pair(MOTIONS["translation"])
    plain = correlate(reference, current, places, reference_mask=mask, interpolation=interpolation)
    first = prepare(reference, mask=mask, interpolation=interpolation, subset_px=31)
    second = prepare(current, interpolation=interpolation)
    for _ in range(2):
        same(correlate(first, second, places, interpolation=interpolation), plain)
    same(correlate(first, current, places, interpolation=interpolation), plain)


@pytest.mark.parametrize("dtype", [np.uint16, np.int16, np.int64, np.float32, np.float64])
def test_the_type_of_the_pixels_does_not_matter(dtype):
    motion, places = MOTIONS["translation"], points(9)
    images = pair(motion)
    eight = correlate(*images, places, guess_px=motion.displacement_px(places))
    other = correlate(*(image.astype(dtype) for image in images), places, guess_px=motion.displacement_px(places))
    np.testing.assert_array_equal(other.status, eight.status)
    np.testing.assert_allclose(other.displacement_px, eight.displacement_px, atol=2e-5)
    np.testing.assert_allclose(other.sigma_px, eight.sigma_px, rtol=0.05)
    found = correlate(*(image.astype(dtype) for image in images), places)
    np.testing.assert_allclose(found.displacement_px, eight.displacement_px, atol=5e-3)


def test_images_at_rest_do_not_move():
    image, _ = pair(translation(0.0, 0.0))
    found = correlate(image, image, points())
    assert found.valid.all()
    np.testing.assert_allclose(found.displacement_px, 0.0, atol=1e-5)
    np.testing.assert_allclose(found.zncc, 1.0, atol=1e-5)


def test_the_noise_is_estimated_or_as_given():
    images, places = pair(MOTIONS["translation"], noise=(1.0, 3.0)), points(21, margin_px=14)
    found = correlate(*images, places)
    assert found.noise_grey == pytest.approx((1.0, 3.0), rel=0.1)
    given = correlate(*images, places, noise_grey=(1.0, 3.0))
    assert given.noise_grey == (1.0, 3.0)
    np.testing.assert_allclose(given.sigma_px, found.sigma_px, rtol=0.1)
    # sigma rests on the residual where that is larger than the noise that is claimed
    low, high = (correlate(*images, places, noise_grey=grey) for grey in (0.0, 6.0))
    # which lacks what noise of the current image the spline smooths away
    np.testing.assert_allclose(low.sigma_px, given.sigma_px, rtol=0.25)
    assert np.all(high.sigma_px > 2 * given.sigma_px)
    np.testing.assert_allclose(found.residual_grey, np.hypot(1.0, 3.0), rtol=0.25)


def test_outside():
    mask = ring()
    places = np.array([(-0.5, 80.0), (100.0, 160.0), (1e6, 1e6), (100.0, 80.0), (100.0, 30.0), (50.3, 80.2)])
    found = correlate(*pair(MOTIONS["half a pixel"]), places, reference_mask=mask)
    assert list(found.status) == [Status.OUTSIDE] * 4 + [Status.VALID] * 2
    assert found.failures == {Status.OUTSIDE: 4}


def test_points_that_leave_the_image_are_outside():
    motion, places = translation(30.0, 0.4), points()
    found = correlate(*pair(motion), places)
    left = ~seen(places, motion, -1.0)
    assert np.count_nonzero(left) > 50
    assert np.mean(found.status[left] == Status.OUTSIDE) > 0.95
    assert not found.valid[left].any()


def test_low_texture():
    reference, current = pair(MOTIONS["half a pixel"])
    for image in (reference, current):
        image[50:110, 60:140] = 128
    places = points(6)
    blank = (abs(places[:, 0] - 99.5) < 29) & (abs(places[:, 1] - 79.5) < 19)
    found = correlate(reference, current, places)
    assert np.count_nonzero(blank) > 40
    assert np.all(found.status[blank] == Status.LOW_TEXTURE)
    away = (abs(places[:, 0] - 99.5) > 56) | (abs(places[:, 1] - 79.5) > 46)
    assert found.valid[away].all()


def test_noise_alone_is_low_texture():
    rng = np.random.default_rng(4)
    reference, current = (digitise(np.full(SIZE[::-1], 120.0), NOISE, rng) for _ in range(2))
    found = correlate(reference, current, points())
    assert not found.valid.any()
    assert found.failures[Status.LOW_TEXTURE] > 0.9 * len(found.valid)


def test_not_converged():
    motion, places = MOTIONS["translation"], points(7, margin_px=14)
    found = correlate(*pair(motion), places, guess_px=motion.displacement_px(places) + 0.4, max_iterations=1)
    assert found.failures == {Status.NOT_CONVERGED: len(places)}
    assert np.isnan(found.displacement_px).all()
    assert np.isnan(found.sigma_px).all()
    assert np.all(found.iterations == 1)


@pytest.mark.parametrize("step_px, subset_px", [(7, 21), (21, 21), (11, 31)])
def test_unrelated_images_have_nothing_in_common(step_px, subset_px):
    rng = np.random.default_rng(6)
    reference, current = (digitise(Speckle(seed=s, size_px=SIZE).image(), NOISE, rng) for s in (4, 5))
    found = correlate(reference, current, points(step_px), subset_px=subset_px)
    assert not found.valid.any()
    assert found.failures[Status.LOW_ZNCC] > 0
    refused = found.status == Status.LOW_ZNCC
    assert np.isfinite(found.zncc[refused]).all()
    assert np.isnan(found.displacement_px[refused]).all()


def test_where_one_place_has_changed_nothing_is_found():
    motion = MOTIONS["translation"]
    reference, current = pair(motion)
    spoilt = Speckle(seed=12, size_px=SIZE).image()[60:100, 80:120]
    current[60:100, 80:120] = digitise(spoilt, NOISE, np.random.default_rng(7))
    places = points(5)
    truth = motion.displacement_px(places)
    found = correlate(reference, current, places)
    moved = np.abs(places + truth - (99.5, 79.5)).max(axis=1)
    off = off_px(found, truth)
    assert np.all(off[(moved < 8) & found.valid] < GROSS_PX)
    assert not found.valid[moved < 8].any()
    assert found.valid[(moved > 32) & seen(places, motion)].all()


def test_zncc_min_is_what_is_asked_for():
    places = points(21, margin_px=14)
    loose = correlate(*pair(MOTIONS["translation"]), places)
    limit = float(np.median(loose.zncc))
    strict = correlate(*pair(MOTIONS["translation"]), places, zncc_min=limit)
    assert 0 < np.count_nonzero(strict.valid) < len(places)
    np.testing.assert_array_equal(strict.status[loose.zncc < limit - 1e-6], Status.LOW_ZNCC)
    assert np.all(strict.zncc[strict.valid] >= limit)


def test_diverged():
    places = points(21, margin_px=20)
    reference, current = (prepare(image) for image in pair(translation(2.0, -1.0)))
    guess = np.zeros((len(places), 6))
    short = solve(reference, current, places, guess, SolverOptions(reach_px=0.5))
    assert np.all(short.status == Status.DIVERGED)
    far = solve(reference, current, places, guess, SolverOptions(reach_px=8.0))
    assert far.valid.all()


def test_no_guess():
    places = points(21, margin_px=20)
    reference, current = (prepare(image) for image in pair(translation(0.3, 0.2)))
    guess = np.zeros((len(places), 6))
    guess[::2, 4] = np.nan
    solved = solve(reference, current, places, guess, SolverOptions())
    assert np.all(solved.status[::2] == Status.NO_GUESS)
    assert solved.valid[1::2].all()
    np.testing.assert_array_equal(
        solved.shape[1::2], solve(reference, current, places[1::2], guess[1::2], SolverOptions()).shape
    )


def test_what_is_not_valid_is_nan():
    motion = translation(30.0, 0.4)
    found = correlate(*pair(motion), points())
    assert 0 < np.count_nonzero(found.valid) < len(found.valid)
    for name in ("displacement_px", "sigma_px", "covariance_px2", "gradient", "shape", "residual_grey"):
        values = getattr(found, name).reshape(len(found.valid), -1)
        assert np.isfinite(values[found.valid]).all(), name
        assert np.isnan(values[~found.valid]).all(), name
    assert sum(found.failures.values()) == np.count_nonzero(~found.valid)
