"""What can not be matched: a refusal that says what, where and what to do, or a point without a match and its why."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.typing import NDArray

from bscd.dic import Correlation, Status, correlate, grid_points, prepare
from bscd.errors import InputError
from tests.dic.motions import translation
from tests.dic.speckle_pairs import Speckle, digitise

SIZE = (96, 80)
SHIFT = (0.4, -0.3)
POINTS = np.array([(48.0, 40.0), (30.0, 30.0), (60.5, 44.25)])


@pytest.fixture(scope="module")
def pair() -> tuple[NDArray[np.uint8], ...]:
    images = Speckle(seed=3, size_px=SIZE).pair(translation(*SHIFT), 2.0)
    for image in images:
        image.flags.writeable = False
    return images


def check(found: Correlation, shift_px: tuple[float, float] = SHIFT, gross_px: float = 0.5) -> None:
    """Nothing wrong is marked valid, and all that is not valid has a reason and no figures."""
    assert np.isin(found.status, list(Status)).all()
    assert np.all(np.hypot(*(found.displacement_px - shift_px).T)[found.valid] < gross_px)
    assert np.isfinite(found.sigma_px[found.valid]).all()
    assert np.isnan(found.displacement_px[~found.valid]).all()


def refusal(words: str, *arguments, **settings) -> None:
    """One sentence: what, and what of it; and what is wanted instead."""
    with pytest.raises(InputError, match=words) as caught:
        correlate(*arguments, **settings)
    text = str(caught.value)
    assert re.match(r"[a-z_ ]+: ", text), text
    assert "\n" not in text
    assert len(text) < 200
    assert not text.endswith(".")


# ---- images ----


def spoilt(image, value):
    grey = image.astype(float)
    grey[10, 20] = value
    return grey


IMAGES = {
    "of other sizes": (lambda a, b: (a, b[:-1]), "images: the reference is 96 x 80 px.*96 x 79"),
    "turned": (lambda a, b: (a, b.T), "one size and type"),
    "of other types": (lambda a, b: (a, b.astype(np.float32)), "uint8.*float32.*one size and type"),
    "empty": (lambda a, b: (a[:0], b[:0]), "reference image: has shape"),
    "without pixels": (lambda a, b: (a, np.zeros((0, 0), np.uint8)), "current image: has shape"),
    "coloured": (lambda a, b: (np.stack([a] * 3, axis=2), b), "reference image: has shape .*monochrome"),
    "a stack": (lambda a, b: (a, b[None]), "current image: has shape .*monochrome"),
    "complex": (lambda a, b: (a.astype(complex), b.astype(complex)), "reference image: .*no grey levels"),
    "binary": (lambda a, b: (a > 120, b > 120), "reference image: .*no grey levels"),
    "text": (lambda a, b: ("a.tif", "b.tif"), "reference image: has shape"),
    "nothing": (lambda a, b: (a, None), "current image: has shape"),
    "objects": (lambda a, b: (a.astype(object), b), "reference image: .*no grey levels"),
    "NaN": (
        lambda a, b: (spoilt(a, np.nan), b.astype(float)),
        "reference image: 1 pixels are not finite; fill and mask",
    ),
    "infinite": (lambda a, b: (a.astype(float), spoilt(b, -np.inf)), "current image: 1 pixels are not finite"),
    "1e300": (lambda a, b: (a.astype(float), spoilt(b, 1e300)), "current image: 1 pixels are not finite"),
    "1e36": (lambda a, b: (a * 1e36, b * 1e36), "reference image: grey levels beyond .*scale"),
    "one bright pixel": (lambda a, b: (a.astype(float), spoilt(b, 3e37)), "current image: grey levels beyond .*scale"),
}


@pytest.mark.parametrize("name", IMAGES)
def test_images_that_are_none(pair, name):
    images, words = IMAGES[name]
    refusal(words, *images(*pair), POINTS)


FLAT = {
    "both": (True, True),
    "the reference": (True, False),
    "the current image": (False, True),
}


@pytest.mark.parametrize("name", FLAT)
@pytest.mark.parametrize("level", [0, 128, 255])
def test_constant_images_match_nowhere(pair, name, level):
    images = [np.full_like(image, level) if flat else image for image, flat in zip(pair, FLAT[name], strict=True)]
    found = correlate(*images, grid_points(SIZE[::-1], 8))
    assert not found.valid.any()
    assert np.isnan(found.displacement_px).all()
    if FLAT[name][0]:
        assert np.all(found.status == Status.LOW_TEXTURE)


@pytest.mark.parametrize("scale, offset", [(1 / 255, 0.0), (-1.0, 0.0), (1.0, 1e6), (1e9, 0.0), (2.0**31, 0.0)])
def test_any_scale_of_grey_levels_will_do(pair, scale, offset):
    found = correlate(*(image * scale + offset for image in pair), POINTS)
    assert found.valid.all()
    check(found, gross_px=0.05)


def test_contrast_below_a_thousandth_of_a_grey_level_is_none(pair):
    found = correlate(*(image * 1e-6 for image in pair), POINTS)
    assert np.all(found.status == Status.LOW_TEXTURE)


@pytest.mark.parametrize("size", [(5, 5), (6, 9), (13, 11), (24, 21), (33, 64), (64, 63), (64, 64), (5, 200)])
@pytest.mark.parametrize("shape", ["affine", "quadratic"])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.4, -0.3), (3.2, 2.1)])
def test_tiny_images(size, shape, shift):
    subset = min(21, min(size) - (min(size) + 1) % 2)
    images = Speckle(seed=8, size_px=size).pair(translation(*shift), 1.0)
    rows, columns = np.indices(size[::-1])
    points = np.column_stack([columns.ravel(), rows.ravel()])[:: max(1, columns.size // 400)].astype(float)
    found = correlate(*images, points, subset_px=subset, shape=shape)
    assert np.isin(found.status, list(Status)).all()
    if subset >= 11:
        check(found, shift)
    if subset == 21 and shape == "affine":
        seen = ((points + shift >= 2) & (points + shift <= np.array(size) - 3)).all(axis=1)
        assert np.mean(found.valid[seen]) > 0.97


# ---- masks ----


MASKS = {
    "of another size": (lambda mask: mask[:-1], "its shape is .79, 96., the image's .80, 96.; give one value a pixel"),
    "all False": (lambda mask: mask & False, "it leaves no pixel to use; True is where"),
    "of floats": (lambda mask: mask.astype(float), "holds True where pixels count, not values of type float64"),
    "of numbers": (lambda mask: [[1, 2], [3, 4]], "its shape is"),
}


@pytest.mark.parametrize("name", MASKS)
@pytest.mark.parametrize("image", ["reference", "current"])
def test_masks_that_are_none(pair, name, image):
    make, words = MASKS[name]
    mask = make(np.ones(SIZE[::-1], bool))
    refusal(f"mask of the {image} image: {words}", *pair, POINTS, **{f"{image}_mask": mask})


@pytest.mark.parametrize("image", ["reference_mask", "current_mask"])
def test_a_mask_of_one_pixel_leaves_too_little(pair, image):
    mask = np.zeros(SIZE[::-1], bool)
    mask[40, 48] = True
    found = correlate(*pair, POINTS, **{image: mask})
    assert np.all(found.status == Status.OUTSIDE)


@pytest.mark.parametrize(
    "shares, some", [((0.1, 1.0), False), ((0.4, 1.0), True), ((1.0, 0.4), True), ((0.7, 0.7), True)]
)
def test_masks_like_salt_and_pepper(pair, shares, some):
    rng = np.random.default_rng(5)
    masks = [rng.random(SIZE[::-1]) < share for share in shares]
    points = grid_points(SIZE[::-1], 4)
    found = correlate(*pair, points, reference_mask=masks[0], current_mask=masks[1])
    check(found)
    left_out = ~masks[0][points[:, 1].astype(int), points[:, 0].astype(int)]
    assert np.all(found.status[left_out] == Status.OUTSIDE)
    assert found.valid.any() == some


def test_integers_are_masks_too(pair):
    mask = np.zeros(SIZE[::-1], np.int64)
    mask[:, :60] = 7
    found = correlate(*pair, POINTS, reference_mask=mask)
    assert list(found.status) == [Status.VALID, Status.VALID, Status.OUTSIDE]


def test_a_prepared_image_has_its_mask_already(pair):
    mask = np.ones(SIZE[::-1], bool)
    refusal("reference image: it is prepared already", prepare(pair[0]), pair[1], POINTS, reference_mask=mask)


def test_images_are_prepared_alike(pair):
    refusal("prepared for subsets of up to 21 px, not 31", prepare(pair[0]), pair[1], POINTS, subset_px=31)
    cubic = prepare(pair[1], interpolation="cubic")
    refusal("one is prepared for quintic, one for cubic", prepare(pair[0]), cubic, POINTS)
    refusal("interpolation: 'linear' is none; quintic or cubic", *pair, POINTS, interpolation="linear")


# ---- points ----


def test_points_that_are_nowhere(pair):
    nan, inf = np.nan, np.inf
    points = np.array(
        [(nan, 1), (1, nan), (inf, 2), (-inf, 3), (1e300, 4), (-1e300, 5), (1e9, 1e9), (-1, -1), (95.5, 40)]
    )
    found = correlate(*pair, np.vstack([points, POINTS]))
    assert np.all(found.status[: len(points)] == Status.OUTSIDE)
    alone = correlate(*pair, POINTS)
    np.testing.assert_array_equal(found.displacement_px[len(points) :], alone.displacement_px)
    check(found)


@pytest.mark.parametrize(
    "points",
    [np.zeros((3, 3)), np.zeros(2), np.zeros((2, 3, 2)), 5.0],
    ids=["of three numbers", "one alone", "a field", "a number"],
)
def test_points_of_another_shape(pair, points):
    refusal(r"points_px: the shape \(N, 2\) is needed", *pair, points)


@pytest.mark.parametrize(
    "points", [POINTS.astype(complex), [("a", "b")], [(1, 2), (3,)], None, [(True, False)]], ids=str
)
def test_points_that_are_no_numbers(pair, points):
    refusal("points_px: holds something that is no real number", *pair, points)


@pytest.mark.parametrize("points", [np.zeros((0, 2)), []], ids=["no rows", "a list"])
@pytest.mark.parametrize("shape, parameters", [("affine", 6), ("quadratic", 12)])
def test_no_points_are_no_error(pair, points, shape, parameters):
    found = correlate(*pair, points, shape=shape)
    assert found.displacement_px.shape == found.sigma_px.shape == (0, 2)
    assert found.gradient.shape == (0, 2, 2)
    assert found.shape.shape == (0, parameters)
    assert found.failures == found.guesses == {}


def test_points_many_times_over(pair):
    found = correlate(*pair, np.tile(POINTS, (40, 1)))
    assert found.valid.all()
    check(found, gross_px=0.05)


def test_lists_and_whole_numbers_are_points_too(pair):
    listed = correlate(*pair, [(48, 40), (30, 30)])
    np.testing.assert_array_equal(listed.displacement_px, correlate(*pair, POINTS[:2]).displacement_px)


# ---- settings ----


@pytest.mark.parametrize("subset", [20, 0, -3, 3, 1, 21.0, 21.5, None, "21", np.nan])
def test_subsets_that_are_none(pair, subset):
    refusal(f"subset_px: is {subset}, an odd number of pixels from 5", *pair, POINTS, subset_px=subset)


@pytest.mark.parametrize("subset", [81, 97, 2001, 10**9 + 1])
def test_subsets_larger_than_the_image(pair, subset):
    refusal(f"subset_px: {subset} is larger than the reference image, 96 x 80 px", *pair, POINTS, subset_px=subset)


def test_a_subset_as_large_as_the_image(pair):
    found = correlate(*pair, POINTS, subset_px=79)
    assert found.valid.all()
    check(found, gross_px=0.02)


SETTINGS = {
    "shape": ["cubic", None, 6],
    "noise_grey": [-1, np.nan, np.inf, (1, 2, 3), (1, np.nan), "two", (1, None)],
    "search_px": [40, 3, -5, 21.0, None],
    "zncc_min": [1.0, -1.5, np.nan],
    "tolerance_px": [0, -1, np.nan, 2],
    "max_iterations": [0, -1, 1.5, None, 2**40],
    "threads": [0, -1],
    "guess_px": [np.zeros((2, 2)), np.zeros((3, 3)), np.zeros(3), "here", np.zeros((3, 2), complex), [[None] * 2] * 3],
}


@pytest.mark.parametrize("name, value", [(name, value) for name in SETTINGS for value in SETTINGS[name]], ids=repr)
def test_settings_that_are_none(pair, name, value):
    refusal(f"{name}: ", *pair, POINTS, **{name: value})


def test_numbers_of_numpy_are_settings_too(pair):
    usual = correlate(*pair, POINTS, subset_px=15, noise_grey=2.0, max_iterations=20)
    other = correlate(*pair, POINTS, subset_px=np.int64(15), noise_grey=np.float32(2), max_iterations=np.int32(20))
    np.testing.assert_array_equal(other.shape, usual.shape)
    np.testing.assert_array_equal(other.sigma_px, usual.sigma_px)


# ---- guesses ----


GUESSES = {
    "a billion": np.full((3, 2), 1e9),
    "minus a billion": np.full((3, 6), -1e9),
    "1e300": np.full((3, 6), 1e300),
    "infinite": np.full((3, 2), np.inf),
    "NaN": np.full((3, 12), np.nan),
    "slopes of five": np.full((3, 6), 5.0),
    "steep beyond reason": np.tile([0.0, 1e5, 0.0, 0.0, 0.0, -1e5], (3, 1)),
    "mirrored": np.tile([0.0, -2.0, 0.0, 0.0, 0.0, 0.0], (3, 1)),
    "all on one spot": np.tile([0.0, -1.0, 0.0, 0.0, 0.0, -1.0], (3, 1)),
    "a half known": np.tile([0.0, np.nan, 0.0, 0.0, np.inf, 0.0], (3, 1)),
    "overflowing": np.tile([0.4, 0.0, 0.0, -0.3, 0.0, 1e308], (3, 1)),
    "curved beyond reason": np.tile([0.0, 0, 0, 1e3, 0, 0, 0, 0, 0, 0, 0, -1e200], (3, 1)),
}


@pytest.mark.parametrize("name", GUESSES)
@pytest.mark.parametrize("shape", ["affine", "quadratic"])
def test_guesses_beyond_reason_do_no_harm(pair, name, shape):
    found = correlate(*pair, POINTS, guess_px=GUESSES[name], shape=shape)
    check(found)
    assert found.valid.all()


@pytest.mark.parametrize("name", GUESSES)
@pytest.mark.parametrize("shape", ["affine", "quadratic"])
def test_guesses_beyond_reason_and_no_others(pair, name, shape):
    found = correlate(*pair, POINTS, guess_px=GUESSES[name], find_guesses=False, shape=shape)
    check(found)


def test_a_guess_that_leads_to_a_blank_place(pair):
    reference, current = pair[0], pair[1].copy()
    current[:, 72:] = 30
    found = correlate(reference, current, POINTS[:2], guess_px=np.array([(36.0, 0.0), (54.0, 0.0)]))
    assert found.valid.all()
    check(found)


def test_noise_is_told_from_nothing(pair):
    # too small an image to estimate its noise from
    small = [image[:20, :20] for image in pair]
    found = correlate(*small, np.array([(10.0, 10.0)]), subset_px=11)
    assert all(np.isfinite(found.noise_grey))
    check(found)
    rng = np.random.default_rng(1)
    noise = [digitise(np.full(SIZE[::-1], 100.0), 5.0, rng) for _ in range(2)]
    nothing = correlate(*noise, grid_points(SIZE[::-1], 6))
    assert not nothing.valid.any()
