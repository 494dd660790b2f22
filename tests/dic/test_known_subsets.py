"""What the kernel keeps of a reference's subsets saves work and changes no bit of a result."""

from __future__ import annotations

import numpy as np
import pytest

from bscd.dic import prepare
from bscd.dic.solver import PARAMETERS, KnownSubsets, Lighting, ShapeName, Solved, SolverOptions, solve
from tests.dic.motions import translation
from tests.dic.speckle_pairs import Speckle

SIZE = (120, 150)
POINTS = np.stack(np.meshgrid(np.arange(8.0, 142.0, 9.3), np.arange(8.0, 112.0, 8.7)), axis=-1).reshape(-1, 2)


def masked() -> np.ndarray:
    mask = np.ones(SIZE, bool)
    mask[40:60, 70:100] = False
    return mask


def images(reference_mask: bool, current_mask: bool):
    speckle, rng = Speckle(size_px=(SIZE[1], SIZE[0])), np.random.default_rng(6)
    first, *later = (
        speckle.image(translation(*moved)) + rng.normal(0.0, 1.0, SIZE)
        for moved in ((0.0, 0.0), (0.3, -0.2), (0.6, 0.1))
    )
    beside = np.roll(masked(), 5, axis=1) if current_mask else None
    return prepare(first, mask=masked() if reference_mask else None), *(prepare(each, mask=beside) for each in later)


def same(one: Solved, other: Solved) -> None:
    for name in ("shape", "found", "status", "iterations"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize("shape", ["translation", "affine", "curved", "quadratic"])
@pytest.mark.parametrize("lighting", ["uniform", "linear"])
@pytest.mark.parametrize(("reference_mask", "current_mask"), [(False, False), (True, False), (True, True)])
def test_results_are_the_same(shape: ShapeName, lighting: Lighting, reference_mask: bool, current_mask: bool):
    first, second, third = images(reference_mask, current_mask)
    options = SolverOptions(shape=shape, lighting=lighting, noise_grey=1.0, noise_both_grey=1.4)
    guess, known = np.zeros((len(POINTS), PARAMETERS[shape])), KnownSubsets.none_of(len(POINTS), shape)
    some = np.arange(0, len(POINTS), 2)[::-1]
    for current, which, threads in ((second, some, 1), (second, np.arange(len(POINTS)), 2), (third, some, 2)):
        alone = solve(first, current, POINTS[which], guess[which], options, threads=1)
        kept = solve(
            first, current, POINTS[which], guess[which], options, threads=threads, known_subsets=known.only(which)
        )
        same(kept, alone)
        assert alone.valid.any()


def test_what_was_kept_is_not_found_again():
    first, second, _ = images(False, False)
    options, guess = SolverOptions(), np.zeros((len(POINTS), 6))
    known = KnownSubsets.none_of(len(POINTS), "affine")
    before = solve(first, second, POINTS, guess, options, known_subsets=known)
    inner = ((POINTS > 14.0) & (np.array(SIZE[::-1]) - 14.0 > POINTS)).all(axis=1)
    assert (known.memory[inner, 0] == 1.0).all()
    known.memory[:, 3] *= 4.0  # the sum of squares about the mean
    after = solve(first, second, POINTS, guess, options, known_subsets=known)
    assert (after.column("gain")[inner] < 0.6 * before.column("gain")[inner]).all()


def test_points_without_a_guess_leave_the_others_their_rows():
    first, second, _ = images(False, False)
    options, guess = SolverOptions(), np.zeros((len(POINTS), 6))
    guess[::3] = np.nan
    known = KnownSubsets.none_of(len(POINTS), "affine")
    for _ in range(2):
        same(
            solve(first, second, POINTS, guess, options, known_subsets=known),
            solve(first, second, POINTS, guess, options),
        )
    assert (known.memory[::3] == 0.0).all()
