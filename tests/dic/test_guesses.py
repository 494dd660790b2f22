"""Which initial guesses the correlator starts from, masks, and what it recovers from."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from bscd.dic import GuessSource, Status, correlate, grid_points, prepare
from bscd.dic.guess import extrapolate, guess_by_search
from tests.dic.exact_pairs import GROSS_PX, MOTIONS, NOISE, SIZE, off_px, pair, points, ring, same, seen, shown
from tests.dic.motions import rotation, stretch, translation
from tests.dic.speckle_pairs import Speckle, digitise


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
    assert not found.valid[~seen(places, motion, -1.0, size)].any()
    if name not in ("30 degrees", "a fifth longer"):
        assert found.guesses[GuessSource.FEATURES] > 0


@pytest.mark.parametrize("name", ["150 px", "90 degrees"])
def test_likenesses_by_chance_do_not_lead_small_subsets_astray(name):
    size, motion = LARGE[name]
    places = points(7, size_px=size)
    found = correlate(*pair(motion, size_px=size), places, subset_px=11)
    off = off_px(found, motion.displacement_px(places))
    # two speckles wide: flow leads to dozens that look alike, and what spreads from them must not be the end of it
    assert np.mean(found.valid[seen(places, motion, size_px=size)]) > 0.95
    assert np.count_nonzero(off[found.valid] > 2.0) <= 0.003 * len(places)
    # least of all where a subset shrinks to a few pixels, which are like anything
    assert np.linalg.det(np.eye(2) + found.gradient[found.valid]).min() > 0.2


@pytest.mark.parametrize("parameters", [6, 12])
def test_what_a_neighbour_lets_expect_is_exact_as_far_as_its_shape_goes(parameters):
    rng = np.random.default_rng(3)
    # coefficients of 1, x, y, x^2, xy, y^2 for u and v
    field = rng.normal(0.0, [[5.0, 0.1, 0.1, 1e-3, 1e-3, 1e-3]] * 2)
    if parameters == 6:
        field[:, 3:] = 0.0

    def shape(at):
        x, y = at.T
        one = np.ones(len(x))
        monomials = [
            [one, x, y, x * x, x * y, y * y],
            [0 * x, one, 0 * x, 2 * x, y, 0 * x],
            [0 * x, 0 * x, one, 0 * x, x, 2 * y],
            *np.eye(6)[3:, :, None] * [[[2.0]], [[1.0]], [[2.0]]] * one,
        ]
        return np.concatenate([np.stack([side @ np.array(row) for row in monomials]) for side in field]).T

    kept = np.arange(12) % 6 < parameters // 2
    here, offset = rng.uniform(-50, 50, (20, 2)), rng.uniform(-30, 30, (20, 2))
    np.testing.assert_allclose(
        extrapolate(shape(here)[:, kept], offset), shape(here + offset)[:, kept], rtol=1e-9, atol=1e-12
    )


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
