"""The correlator on pairs with exact truth: how accurate, how sure, from which guesses, and why points fail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from bscd.dic import Correlation, GuessSource, Status, correlate, grid_points, prepare
from bscd.dic.guess import guess_by_search
from bscd.dic.solver import SolverOptions, solve
from tests.dic.cramer_rao import cramer_rao_px
from tests.dic.motions import FloatArray, Motion, rotation, sinusoid, stretch, translation
from tests.dic.speckle_pairs import Speckle, digitise

SIZE = (200, 160)
NOISE = 2.0
MOTIONS: dict[str, Motion] = {
    "half a pixel": translation(0.5, 0.5),
    "translation": translation(3.37, -2.61),
    "stretch": stretch(0.02, SIZE),
    "rotation": rotation(3.0, SIZE),
}

#: Farther off than this is no measurement of the point at all.
GROSS_PX = 0.5


@cache
def speckle(size_px: tuple[int, int] = SIZE, seed: int = 4) -> Speckle:
    return Speckle(seed=seed, size_px=size_px)


@cache
def shown(motion: Motion, size_px: tuple[int, int] = SIZE) -> FloatArray:
    return speckle(size_px).image(motion)


def pair(
    motion: Motion, seed: int = 0, noise: tuple[float, float] = (NOISE, NOISE), size_px: tuple[int, int] = SIZE
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    rest, moved = shown(translation(0.0, 0.0), size_px), shown(motion, size_px)
    rng = np.random.default_rng(seed)
    return digitise(rest, noise[0], rng), digitise(moved, noise[1], rng)


def points(step_px: int = 7, margin_px: int = 0, size_px: tuple[int, int] = SIZE) -> FloatArray:
    return grid_points(size_px[::-1], step_px, margin_px=margin_px)


def off_px(found: Correlation, truth: FloatArray) -> FloatArray:
    """Distance ``(N,)`` from the truth; NaN where a point is not valid."""
    return np.hypot(*(found.displacement_px - truth).T)


def seen(places: FloatArray, motion: Motion, margin_px: float = 0.0, size_px: tuple[int, int] = SIZE) -> NDArray:
    """Points that the current image shows."""
    moved = places + motion.displacement_px(places)
    return ((moved >= margin_px) & (moved <= np.array(size_px) - 1 - margin_px)).all(axis=1)


def same(one: Correlation, other: Correlation) -> None:
    for field in fields(Correlation):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)


# ---- accuracy ----


def series(
    motion: Motion, noise: tuple[float, float], seeds: int, **settings
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Errors and sigmas ``(n, 2)`` of points whose subsets do not overlap, and their Cramer-Rao limits."""
    places = points(21, margin_px=14)
    truth = motion.displacement_px(places)
    limit = cramer_rao_px(
        shown(translation(0.0, 0.0)),
        speckle().gradient(),
        places.astype(np.int64),
        noise,
        settings.get("subset_px", 21),
    )
    errors, sigmas = [], []
    for seed in range(seeds):
        found = correlate(*pair(motion, seed, noise), places, **settings)
        assert found.valid.all()
        errors.append(found.displacement_px - truth)
        sigmas.append(found.sigma_px)
    return np.concatenate(errors), np.concatenate(sigmas), np.tile(limit, (seeds, 1))


@pytest.mark.parametrize("name", MOTIONS)
def test_scatter_is_at_the_cramer_rao_limit_and_sigma_says_so(name):
    errors, sigmas, limit = series(MOTIONS[name], (NOISE, NOISE), seeds=16)
    rounding = np.sqrt(1 + 1 / (12 * NOISE**2))
    n = errors.size
    scatter = np.sqrt(np.mean((errors / (limit * rounding)) ** 2))
    # known to 1 / sqrt(2 n), 1.6 %
    assert 1 - 3 / np.sqrt(2 * n) < scatter < 1.05 + 3 / np.sqrt(2 * n)
    assert np.mean(np.abs(errors) < sigmas) == pytest.approx(0.683, abs=0.05)
    assert np.mean(np.abs(errors) < 2 * sigmas) == pytest.approx(0.954, abs=0.03)
    assert np.all(np.abs(errors.mean(axis=0)) < 4 * errors.std(axis=0) / np.sqrt(n / 2))


@pytest.mark.parametrize("noise", [(1.0, 1.0), (0.5, 3.0), (5.0, 5.0)])
@pytest.mark.parametrize("settings", [{}, {"subset_px": 15}, {"subset_px": 31}, {"interpolation": "cubic"}])
def test_sigma_is_calibrated(noise, settings):
    errors, sigmas, _ = series(MOTIONS["translation"], noise, seeds=5, **settings)
    # 630 values
    assert np.mean(np.abs(errors) < sigmas) == pytest.approx(0.683, abs=0.05 + 0.02)
    assert np.sqrt(np.mean((errors / sigmas) ** 2)) == pytest.approx(1.0, abs=0.12)


def test_the_covariance_is_that_of_the_errors():
    places = np.array([(60.0, 60.0), (100.0, 80.0), (141.0, 97.0)])
    motion = MOTIONS["translation"]
    results = [correlate(*pair(motion, seed), places) for seed in range(200)]
    errors = np.array([found.displacement_px - motion.displacement_px(places) for found in results])
    for i in range(len(places)):
        stated = np.mean([found.covariance_px2[i] for found in results], axis=0)
        # variances are known to a tenth, so are the covariances relative to them
        np.testing.assert_allclose(np.cov(errors[:, i].T), stated, atol=0.3 * np.trace(stated) / 2)
    np.testing.assert_allclose(results[0].sigma_px ** 2, results[0].covariance_px2[:, [0, 1], [0, 1]])


@pytest.mark.parametrize("across", [0.1, 0.25, 0.5, 0.7])
def test_bias_is_below_a_ten_thousandth_of_a_pixel_without_noise(across):
    motion = translation(across, -0.4)
    rest, moved = (shown(m).astype(np.float32) for m in (translation(0.0, 0.0), motion))
    found = correlate(rest, moved, points(7, margin_px=14))
    assert found.valid.all()
    error = found.displacement_px - (across, -0.4)
    assert np.abs(error.mean(axis=0)).max() < 1e-4
    assert np.abs(error).max() < 1e-3


def test_cubic_interpolation_is_its_own_choice():
    rest, moved = (shown(m).astype(np.float32) for m in (translation(0.0, 0.0), translation(0.25, -0.4)))
    off = {}
    for name in ("cubic", "quintic"):
        found = correlate(rest, moved, points(7, margin_px=14), interpolation=name)
        off[name] = np.sqrt(np.mean((found.displacement_px - (0.25, -0.4)) ** 2))
    assert 3 * off["quintic"] < off["cubic"] < 2e-3


def test_gradients_are_those_of_the_motion():
    motion = rotation(3.0, SIZE)
    angle = np.radians(3.0)
    found = correlate(*pair(motion), points(7, margin_px=14))
    wanted = np.array([[np.cos(angle) - 1, -np.sin(angle)], [np.sin(angle), np.cos(angle) - 1]])
    error = found.gradient[found.valid] - wanted
    # a sigma of 0.008 px over a lever of 6 px rms
    assert np.abs(error).max() < 0.01
    np.testing.assert_allclose(error.mean(axis=0), 0.0, atol=3e-4)


def test_second_order_follows_a_steep_sinusoid():
    motion = sinusoid(1.0, 64.0)
    places = points(7, margin_px=14)
    truth = motion.displacement_px(places)
    found = {shape: correlate(*pair(motion), places, shape=shape) for shape in ("affine", "quadratic")}
    rms = {shape: np.sqrt(np.mean((one.displacement_px - truth)[one.valid] ** 2)) for shape, one in found.items()}
    for one in found.values():
        assert np.mean(one.valid) > 0.995
    assert rms["quadratic"] < 0.03 < 3 * rms["quadratic"] < rms["affine"]
    k = 2 * np.pi / 64.0
    slope = -k * np.sin(k * places[:, 1])
    assert np.sqrt(np.mean((found["quadratic"].gradient[:, 1, 1] - slope)[found["quadratic"].valid] ** 2)) < 0.02
    assert found["quadratic"].shape.shape == (len(places), 12)


def test_near_borders_points_are_matched_with_less():
    places = points(7)
    motion = translation(0.3, 0.4)
    border = (places < 8).any(axis=1) | (places > np.array(SIZE) - 9).any(axis=1)
    errors, sigmas = [], []
    for seed in range(4):
        found = correlate(*pair(motion, seed), places)
        shown_in_both = seen(places, motion)
        assert found.valid[shown_in_both].all()
        assert np.all(off_px(found, motion.displacement_px(places))[shown_in_both] < GROSS_PX)
        errors.append((found.displacement_px - motion.displacement_px(places))[border & shown_in_both])
        sigmas.append(found.sigma_px[border & shown_in_both])
        assert found.pixels[border & shown_in_both].max() < 21**2
        assert np.median(found.sigma_px[border & shown_in_both]) > 1.3 * np.median(found.sigma_px[~border])
    # neighbours overlap, so the share is less certain than its count says
    assert np.mean(np.abs(np.concatenate(errors)) < np.concatenate(sigmas)) == pytest.approx(0.683, abs=0.07)


# ---- masks ----


def ring() -> NDArray[np.bool_]:
    rows, columns = np.indices(SIZE[::-1])
    distance = np.hypot(columns - 100, rows - 80)
    return (distance > 30) & (distance < 70)


def angle() -> NDArray[np.bool_]:
    rows, columns = np.indices(SIZE[::-1])
    return (columns < 60) | (rows > 110)


@pytest.mark.parametrize("region", [ring, angle])
def test_regions_of_any_shape(region: Callable[[], NDArray[np.bool_]]):
    motion, mask = translation(3.37, -2.61), region()
    # what lies outside the region moves otherwise and must not be looked at, but by the spline's taps
    elsewhere = shown(translation(-8.0, 9.0))
    rng = np.random.default_rng(3)
    rows, columns = np.indices(mask.shape)
    x, y = np.rint(columns - 3.37).astype(int), np.rint(rows + 2.61).astype(int)
    inside = (x >= 0) & (y >= 0) & (x < SIZE[0]) & (y < SIZE[1])
    current_mask = inside & mask[np.where(inside, y, 0), np.where(inside, x, 0)]
    near = ndimage.binary_dilation(current_mask, iterations=3)
    current = digitise(np.where(near, shown(motion), elsewhere), NOISE, rng)
    reference = digitise(shown(translation(0.0, 0.0)), NOISE, rng)
    places = grid_points(mask.shape, 5, mask=mask)
    found = correlate(reference, current, places, reference_mask=mask, current_mask=current_mask)
    assert found.valid[seen(places, motion, 1.0)].all()
    error = (found.displacement_px - (3.37, -2.61))[found.valid]
    assert np.hypot(*error.T).max() < GROSS_PX
    # overlapping subsets: fewer samples than points
    assert np.mean(np.abs(error) < found.sigma_px[found.valid]) == pytest.approx(0.683, abs=0.08)
    cut = (found.pixels < 300) & found.valid
    assert np.count_nonzero(cut) > 50
    assert np.median(found.sigma_px[cut]) > np.median(found.sigma_px[found.valid & ~cut])


# ---- guesses ----


def test_a_small_motion_needs_flow_at_few_points_only():
    found = correlate(*pair(translation(0.3, 0.4)), points())
    assert set(found.guesses) == {GuessSource.FLOW, GuessSource.PROPAGATED}
    assert found.guesses[GuessSource.FLOW] < 0.2 * len(found.valid)
    assert sum(found.guesses.values()) == len(found.valid)


LARGE = {
    "150 px": ((320, 200), translation(150.3, 0.4)),
    "40 px": (SIZE, translation(40.3, -22.0)),
    "30 degrees": ((260, 220), rotation(30.0, (260, 220))),
    "90 degrees": ((260, 220), rotation(90.0, (260, 220))),
    "half a turn": (SIZE, rotation(180.0, SIZE)),
    "a fifth longer": (SIZE, stretch(0.2, SIZE)),
}


@pytest.mark.parametrize("name", LARGE)
def test_large_motions_without_a_guess(name):
    size, motion = LARGE[name]
    places = points(7, size_px=size)
    found = correlate(*pair(motion, size_px=size), places)
    visible = seen(places, motion, size_px=size)
    off = off_px(found, motion.displacement_px(places))
    assert np.mean(found.valid[visible]) > 0.99
    assert np.all(off[found.valid] < GROSS_PX)
    assert np.all(found.status[~visible & ~found.valid] != Status.VALID)
    assert not found.valid[~seen(places, motion, -1.0, size)].any()
    if name not in ("30 degrees", "a fifth longer"):
        assert found.guesses[GuessSource.FEATURES] > 0


@pytest.mark.parametrize(
    "left, right", [((0.0, -6.0), (0.0, 6.0)), ((-6.0, 0.0), (6.0, 0.0)), ((0.0, 0.0), (0.3, 12.3))], ids=str
)
def test_two_halves_that_move_apart(left, right):
    columns, crack = np.arange(SIZE[0])[None, :], SIZE[0] // 2
    opening = max(right[0] - left[0], 0.0)
    gap = (columns >= crack + left[0]) & (columns < crack + left[0] + opening)
    apart = np.where(columns < crack + left[0], shown(translation(*left)), shown(translation(*right)))
    beneath = Speckle(seed=9, size_px=SIZE).image()
    rng = np.random.default_rng(2)
    current = digitise(np.where(gap, beneath, apart), NOISE, rng)
    reference = digitise(shown(translation(0.0, 0.0)), NOISE, rng)
    places = points(5)
    truth = np.where(places[:, :1] < crack, left, right)
    within = (places[:, 0] + 10 < crack) | (places[:, 0] - 10 >= crack)
    moved = places + truth
    visible = within & ((moved > 3) & (moved < np.array(SIZE) - 4)).all(axis=1)
    found = correlate(reference, current, places)
    off = off_px(found, truth)
    assert np.all(off[within & found.valid] < GROSS_PX)
    assert np.mean(found.valid[visible]) > 0.99


def test_a_given_guess_is_used_and_reported():
    motion, places = rotation(3.0, SIZE), points(7, margin_px=14)
    truth = motion.displacement_px(places)
    given = correlate(*pair(motion), places, guess_px=truth + 0.3)
    assert given.guesses == {GuessSource.GIVEN: len(places)}
    # an exact guess with gradients needs fewer iterations than one without
    shape = correlate(*pair(motion), places).shape
    again = correlate(*pair(motion), places, guess_px=shape)
    assert again.guesses == {GuessSource.GIVEN: len(places)}
    assert again.iterations.mean() < given.iterations.mean()
    assert np.all(again.iterations <= 2)
    np.testing.assert_allclose(again.displacement_px, given.displacement_px, atol=2e-3)


@pytest.mark.parametrize("shape, width", [("affine", 12), ("quadratic", 6), ("quadratic", 2), ("quadratic", 12)])
def test_guesses_in_all_their_forms(shape, width):
    motion, places = rotation(3.0, SIZE), points(14, margin_px=14)
    guess = np.zeros((len(places), width))
    guess[:, [0, width // 2]] = motion.displacement_px(places)
    if width > 2:
        guess[:, 2], guess[:, width // 2 + 1] = -np.sin(np.radians(3.0)), np.sin(np.radians(3.0))
    found = correlate(*pair(motion), places, guess_px=guess, shape=shape)
    assert found.guesses == {GuessSource.GIVEN: len(places)}
    assert np.all(off_px(found, motion.displacement_px(places)) < 0.1)
    assert np.all(found.iterations <= (4 if width > 2 else 8))


@pytest.mark.parametrize("wrong_px", [3.0, 15.0, 40.0, 1e9])
def test_a_wrong_guess_is_recovered_from(wrong_px):
    motion, places = MOTIONS["translation"], points(7, margin_px=14)
    truth = motion.displacement_px(places)
    found = correlate(*pair(motion), places, guess_px=truth + (wrong_px, -wrong_px))
    assert found.valid.all()
    assert np.all(off_px(found, truth) < GROSS_PX)
    if wrong_px > 20:
        assert GuessSource.GIVEN not in found.guesses


def test_a_few_wrong_guesses_among_good_ones():
    motion, places = MOTIONS["translation"], points(7, margin_px=14)
    truth = motion.displacement_px(places)
    guess = truth.copy()
    wrong = np.random.default_rng(1).random(len(places)) < 0.2
    guess[wrong] += np.random.default_rng(2).uniform(-60, 60, (np.count_nonzero(wrong), 2))
    found = correlate(*pair(motion), places, guess_px=guess)
    assert found.valid.all()
    assert np.all(off_px(found, truth) < GROSS_PX)


def test_guesses_that_are_not_known_come_from_neighbours():
    motion, places = MOTIONS["translation"], points(7, margin_px=14)
    guess = np.full((len(places), 2), np.nan)
    guess[100] = (3.0, -3.0)
    found = correlate(*pair(motion), places, guess_px=guess)
    assert found.guesses == {GuessSource.GIVEN: 1, GuessSource.PROPAGATED: len(places) - 1}
    assert found.guess[100] == GuessSource.GIVEN
    nothing = correlate(*pair(motion), places, guess_px=np.full((len(places), 6), np.nan))
    same(nothing, correlate(*pair(motion), places))


def test_only_given_guesses_when_none_are_to_be_found():
    motion, places = MOTIONS["translation"], points(7, margin_px=14)
    unknown = np.full((len(places), 2), np.nan)
    found = correlate(*pair(motion), places, guess_px=unknown, find_guesses=False)
    assert found.failures == {Status.NO_GUESS: len(places)}
    assert found.guesses == {GuessSource.NONE: len(places)}
    unknown[50] = (3.0, -3.0)
    found = correlate(*pair(motion), places, guess_px=unknown, find_guesses=False)
    assert found.valid.all()
    assert np.all(off_px(found, motion.displacement_px(places)) < GROSS_PX)


def test_search_alone_finds_the_whole_pixel():
    motion, places = translation(7.2, -8.8), points(14)
    reference, current = (prepare(image) for image in pair(motion))
    found = guess_by_search(reference, current, places, np.zeros_like(places), 21, 41)
    visible = seen(places, motion, 10.0)
    assert np.count_nonzero(visible) > 80
    np.testing.assert_array_equal(found[visible][:, [0, 3]], np.tile([7.0, -9.0], (np.count_nonzero(visible), 1)))
    assert not found[:, [1, 2, 4, 5]].any()


def test_search_is_about_what_is_expected():
    motion, places = translation(25.0, -31.0), points(14, margin_px=20)
    reference, current = (prepare(image) for image in pair(motion))
    visible = seen(places, motion, 10.0)
    about = np.tile([20.0, -25.0], (len(places), 1))
    found = guess_by_search(reference, current, places, about, 21, 41)
    np.testing.assert_array_equal(found[visible][:, [0, 3]], np.tile([25.0, -31.0], (np.count_nonzero(visible), 1)))
    # out of the window, out of reach; and no window, no guess
    short = guess_by_search(reference, current, places, about - 20.0, 21, 41)
    assert np.abs(short[visible][:, [0, 3]] - (25.0, -31.0)).max(axis=1).min() >= 1
    assert np.isnan(guess_by_search(reference, current, places, about + 400.0, 21, 41)).all()


def test_search_serves_images_too_small_for_flow():
    small = (60, 50)
    motion = translation(6.3, -4.8)
    places = points(13, size_px=small)  # too few to look for features
    found = correlate(*pair(motion, size_px=small), places)
    visible = seen(places, motion, 2.0, small)
    assert np.all(found.valid[visible])
    assert np.all(off_px(found, motion.displacement_px(places))[found.valid] < GROSS_PX)
    assert GuessSource.FLOW not in found.guesses
    assert found.guesses[GuessSource.SEARCH] > 0


# ---- the same whatever ----


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


# ---- why points fail ----


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


def test_a_translation_holds_the_gradients_it_is_given():
    """With the true gradients held, u and v alone are surer than among six parameters, and no less right."""
    size = (200, 160)
    motion = stretch(0.02, size)
    points = grid_points(size[::-1], 7, margin_px=14)
    truth = motion.displacement_px(points)
    right, down = (motion.displacement_px(points + step) - truth for step in np.eye(2))
    given = np.column_stack([truth[:, 0], right[:, 0], down[:, 0], truth[:, 1], right[:, 1], down[:, 1]])
    reference, current = Speckle(seed=5, size_px=size).pair(motion, 2.0, 5)
    held = correlate(reference, current, points, guess_px=given, shape="translation")
    free = correlate(reference, current, points)
    assert held.valid.all()
    np.testing.assert_allclose(held.gradient[:, 0, 0], 0.02, atol=1e-9)
    rms = [np.sqrt(np.mean((found.displacement_px - truth) ** 2)) for found in (held, free)]
    assert rms[0] < 0.98 * rms[1]
    assert (held.sigma_px < free.sigma_px).all()
