"""What holds whatever the images: contrast, mirroring, exchange, and that nothing wrong is called right."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from bscd.dic import Status, correlate, grid_points
from tests.dic.motions import Affine, centre_of, translation
from tests.dic.speckle_pairs import Speckle, digitise

SIZE = (130, 110)
POINTS = grid_points(SIZE[::-1], 12, margin_px=16)
SPECKLE = Speckle(seed=11, size_px=SIZE)
NOISE = 2.0


def few(examples: int):
    """The same few examples every time."""
    return settings(max_examples=examples, derandomize=True, deadline=None, database=None)


def noisy(motion, seed=0):
    """A pair of float images, so that a change of contrast rounds nothing."""
    rng = np.random.default_rng(seed)
    return [
        (image + rng.normal(0.0, NOISE, image.shape)).astype(np.float32)
        for image in (SPECKLE.image(), SPECKLE.image(motion))
    ]


@pytest.fixture(scope="module")
def floats():
    return noisy(translation(1.4, -0.7))


@few(12)
@given(gain=st.floats(0.3, 3.0), offset=st.floats(-200.0, 200.0), which=st.sampled_from([0, 1]))
def test_gain_and_offset_do_not_matter(floats, gain, offset, which):
    changed = list(floats)
    changed[which] = (gain * changed[which] + offset).astype(np.float32)
    guess = np.full((len(POINTS), 2), (1.0, -1.0))
    before, after = (correlate(*pair, POINTS, guess_px=guess) for pair in (floats, changed))
    np.testing.assert_array_equal(after.status, before.status)
    np.testing.assert_allclose(after.displacement_px, before.displacement_px, atol=1e-4)
    # sums of squares in single precision, far from the mean that the reference would have
    np.testing.assert_allclose(after.zncc, before.zncc, atol=1e-4)
    np.testing.assert_allclose(after.sigma_px, before.sigma_px, rtol=0.05)
    # and without a guess all is found as well
    found = correlate(*changed, POINTS)
    assert found.valid.all()
    np.testing.assert_allclose(found.displacement_px, before.displacement_px, atol=3e-3)


@few(12)
@given(across=st.floats(-5.0, 5.0), down=st.floats(-5.0, 5.0), seed=st.integers(0, 1000))
def test_any_shift_is_recovered(across, down, seed):
    rng = np.random.default_rng(seed)
    images = [digitise(image, NOISE, rng) for image in (SPECKLE.image(), SPECKLE.image(translation(across, down)))]
    found = correlate(*images, POINTS)
    assert found.valid.all()
    error = found.displacement_px - (across, down)
    assert np.all(np.abs(error) < 5.5 * found.sigma_px)
    # the mean of 90 subsets that overlap little
    assert np.all(np.abs(error.mean(axis=0)) < 5 * np.median(found.sigma_px) / np.sqrt(30))
    assert np.abs(found.gradient).max() < 0.02


MIRRORS = {
    "left to right": (lambda image: image[:, ::-1], lambda p: np.array([SIZE[0] - 1, 0]) - p * (1, -1), (-1.0, 1.0)),
    "upside down": (lambda image: image[::-1], lambda p: np.array([0, SIZE[1] - 1]) - p * (-1, 1), (1.0, -1.0)),
    "by half a turn": (lambda image: image[::-1, ::-1], lambda p: np.array(SIZE) - 1 - p, (-1.0, -1.0)),
}


@pytest.mark.parametrize("name", MIRRORS)
@pytest.mark.parametrize("shape", ["affine", "quadratic"])
@few(4)
@given(across=st.floats(-3.0, 3.0), turn=st.floats(-0.05, 0.05))
def test_mirrored_images_mirror_the_field(name, shape, across, turn):
    mirror, move, sign = MIRRORS[name]
    images = noisy(Affine(((1.01, -turn), (turn, 1.0)), (across, 0.4), centre_of(SIZE)))
    places = np.vstack([POINTS, POINTS + (3.4, 0.0), POINTS * (0.0, 1.0) + (4.0, 0.0)])
    # single precision rounds otherwise the other way round, so the last step is a small one
    plain = correlate(*images, places, shape=shape, tolerance_px=1e-4)
    turned = correlate(*(mirror(image) for image in images), move(places), shape=shape, tolerance_px=1e-4)
    np.testing.assert_array_equal(turned.valid, plain.valid)
    assert np.mean(plain.valid) > 0.8
    apart = np.abs(turned.displacement_px - plain.displacement_px * sign) / plain.sigma_px
    assert np.nanmedian(apart) < 0.01
    # a pixel on a border is in or out as the first iterations, from flow, have it; the rest follows
    alike = (turned.pixels == plain.pixels) & plain.valid
    assert np.mean(alike) > 0.7
    assert np.all(apart[alike] < 0.2)
    assert np.all(apart[plain.valid] < 3.0)
    np.testing.assert_allclose(turned.sigma_px[alike], plain.sigma_px[alike], rtol=0.1)


@few(5)
@given(across=st.floats(-3.0, 3.0), down=st.floats(-3.0, 3.0))
def test_rows_and_columns_are_alike(across, down):
    images = noisy(translation(across, down))
    plain = correlate(*images, POINTS, tolerance_px=1e-4)
    turned = correlate(*(image.T for image in images), POINTS[:, ::-1], tolerance_px=1e-4)
    np.testing.assert_array_equal(turned.status, plain.status)
    np.testing.assert_allclose(turned.displacement_px[:, ::-1], plain.displacement_px, atol=2e-4)
    np.testing.assert_allclose(turned.sigma_px[:, ::-1], plain.sigma_px, rtol=1e-3)
    np.testing.assert_allclose(turned.gradient[:, ::-1, ::-1], plain.gradient, atol=2e-5)


@few(8)
@given(across=st.floats(-4.0, 4.0), down=st.floats(-4.0, 4.0), seed=st.integers(0, 1000))
def test_there_and_back(across, down, seed):
    reference, current = noisy(translation(across, down), seed)
    there = correlate(reference, current, POINTS)
    back = correlate(current, reference, POINTS + there.displacement_px)
    both = there.displacement_px + back.displacement_px
    assert there.valid.all()
    assert back.valid.all()
    assert np.all(np.abs(both) < 3 * there.sigma_px)
    assert np.sqrt(np.mean((both / there.sigma_px) ** 2)) < 0.7
    np.testing.assert_allclose(back.sigma_px, there.sigma_px, rtol=0.25)


REGIONS = ("everything", "half plane", "ring", "stripes", "chance")
PLACES = ("grid", "anywhere", "one", "none", "infinite")


def region(kind, seed):
    """A mask ``(H, W)``, None for everything."""
    rng = np.random.default_rng(seed)
    rows, columns = np.indices(SIZE[::-1])
    if kind == "half plane":
        angle, offset = rng.uniform(0.0, 6.28), rng.uniform(-30.0, 30.0)
        return np.cos(angle) * (columns - SIZE[0] / 2) + np.sin(angle) * (rows - SIZE[1] / 2) > offset
    if kind == "ring":
        distance = np.hypot(columns - rng.uniform(40, 90), rows - rng.uniform(40, 70))
        return np.abs(distance - rng.uniform(0.0, 40.0)) < rng.uniform(3.0, 30.0)
    if kind == "stripes":
        return (columns * rng.integers(0, 3) + rows) % rng.integers(2, 40) <= rng.integers(0, 20)
    if kind == "chance":
        return rng.random(rows.shape) < rng.uniform(0.05, 0.95)
    return None


def points_at(kind, seed):
    rng = np.random.default_rng(seed)
    if kind == "grid":
        return grid_points(SIZE[::-1], int(rng.integers(4, 12)))
    some = rng.uniform(-5.0, 135.0, ({"one": 1, "none": 0}.get(kind, 40), 2))
    if kind == "infinite":
        some[:9].flat = [np.nan, np.inf, -np.inf, 1e300, -1e300, 1e9, 5e-324, -0.0, np.nan] * 2
    return some


def guessed(kind, width, truth):
    """A guess ``(N, 2, 6 or 12)``, off the truth by up to 3 or 30 px, or one value for all; None for none."""
    if kind == "none":
        return None
    whole = np.zeros((len(truth), width))
    if kind in ("near", "far"):
        off = 3.0 if kind == "near" else 30.0
        whole[:, [0, width // 2]] = truth + np.random.default_rng(1).uniform(-off, off, truth.shape)
        return whole
    return whole + float(kind)


@few(60)
@given(
    at=st.sampled_from(PLACES),
    regions=st.tuples(st.sampled_from(REGIONS), st.sampled_from(REGIONS)),
    seed=st.integers(0, 1000),
    subset=st.integers(2, 20).map(lambda radius: 2 * radius + 1),
    shape=st.sampled_from(["affine", "quadratic", "translation"]),
    interpolation=st.sampled_from(["quintic", "cubic"]),
    shift=st.tuples(st.floats(-12.0, 12.0), st.floats(-12.0, 12.0)),
    noise=st.sampled_from([0.0, 1.0, 4.0]),
    guess=st.tuples(
        st.sampled_from(["none", "near", "far", "nan", "inf", "1e9", "1e300", "-1e5", "0.7"]),
        st.sampled_from([2, 6, 12]),
    ),
    find=st.booleans(),
)
def test_nothing_wrong_is_called_right(at, regions, seed, subset, shape, interpolation, shift, noise, guess, find):
    rng = np.random.default_rng(3)
    reference, current = (
        digitise(image, noise, rng) for image in (SPECKLE.image(), SPECKLE.image(translation(*shift)))
    )
    points = points_at(at, seed)
    reference_mask, current_mask = (region(kind, seed + k) for k, kind in enumerate(regions))
    truth = np.tile(shift, (len(points), 1))
    found = correlate(
        reference,
        current,
        points,
        subset_px=subset,
        shape=shape,
        interpolation=interpolation,
        reference_mask=reference_mask,
        current_mask=current_mask,
        guess_px=guessed(*guess, truth),
        find_guesses=find,
    )
    assert np.isin(found.status, list(Status)).all()
    assert np.isnan(found.displacement_px[~found.valid]).all()
    valid = found.valid
    off = np.hypot(*(found.displacement_px - truth)[valid].T)
    # pieces of subsets may be sure to no better than half a pixel; those of less than three speckles also look alike,
    # and those of one speckle are only to do no harm
    gross = off > np.maximum(0.5, 5 * np.hypot(*found.sigma_px[valid].T))
    assert subset < 9 or np.count_nonzero(gross) <= (0 if subset >= 15 else 1 + 0.05 * len(points))
    # what is valid lies on both images and, to a pixel, on what both masks allow
    for where, mask in ((points, reference_mask), (points + found.displacement_px, current_mask)):
        column, row = np.floor(where[valid] + 0.5).astype(int).T
        assert np.all((column >= 0) & (row >= 0) & (column < SIZE[0]) & (row < SIZE[1]))
        assert mask is None or ndimage.binary_dilation(mask, np.ones((3, 3)))[row, column].all()


@few(15)
@given(
    seeds=st.tuples(st.integers(0, 50), st.integers(51, 99)),
    subset=st.sampled_from([21, 31, 41]),
    step=st.sampled_from([5, 11, 30]),
    noise=st.sampled_from([0.5, 2.0, 6.0]),
)
def test_unrelated_images_are_not_related(seeds, subset, step, noise):
    rng = np.random.default_rng(0)
    images = [digitise(Speckle(seed=seed, size_px=SIZE).image(), noise, rng) for seed in seeds]
    found = correlate(*images, grid_points(SIZE[::-1], step), subset_px=subset)
    assert not found.valid.any()
