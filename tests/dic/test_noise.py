"""Noise from one image and from a pair: against noise that was added, on exact speckles and on the twin's frames."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bscd.dic.noise import estimate_noise, noise_from_pair
from bscd.errors import InputError
from drivers.twin.world import World
from tests.dic.speckle_pairs import Speckle, digitise
from tests.drivers.twin.rigs import coarse_options

SIZE = (640, 512)
NOISES = [0.5, 1.0, 2.0, 4.0, 8.0]


@pytest.fixture(scope="module")
def clean():
    return Speckle(size_px=SIZE).image()


@pytest.fixture(scope="module")
def noisy(clean):
    return digitise(clean, 2.0, np.random.default_rng(1))


def rms(image, clean):
    """The noise that is in an image, rounding included."""
    return np.sqrt(np.mean((image - clean) ** 2))


def shot(clean, offset, slope, seed):
    noise = np.random.default_rng(seed).normal(size=clean.shape) * np.sqrt(offset + slope * clean)
    return np.clip(np.rint(clean + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("noise", NOISES)
def test_added_noise_is_found_in_one_image_of_speckles(clean, noise):
    image = digitise(clean, noise, np.random.default_rng(7))
    found = estimate_noise(image)
    assert found.sigma_grey == pytest.approx(rms(image, clean), rel=0.03)
    assert found.slope_grey * 200.0 < 0.15 * found.offset_grey2


@pytest.mark.parametrize("noise", NOISES)
def test_added_noise_is_found_in_a_pair(clean, noise):
    rng = np.random.default_rng(8)
    first, second = (digitise(clean, noise, rng) for _ in range(2))
    truth = np.hypot(rms(first, clean), rms(second, clean)) / np.sqrt(2.0)
    assert noise_from_pair(first, second).sigma_grey == pytest.approx(truth, rel=0.02)


def test_without_noise_rounding_is_left(clean):
    image = digitise(clean, 0.0, np.random.default_rng(0))
    assert 0.2 < estimate_noise(image).sigma_grey < 0.35
    assert estimate_noise(clean).sigma_grey < 0.05
    assert noise_from_pair(image, image).sigma_grey == 0.0


def test_noise_that_grows_with_the_level(clean):
    offset, slope = 0.25, 0.021
    first, second = (shot(clean, offset, slope, seed) for seed in (3, 4))
    level = np.array([40.0, 120.0, 220.0])
    truth = offset + slope * level + 1.0 / 12.0
    for found, within in ((estimate_noise(first), 0.1), (noise_from_pair(first, second), 0.06)):
        np.testing.assert_allclose(found.variance_at(level), truth, rtol=within)
        assert found.slope_grey == pytest.approx(slope, rel=within)
        assert found.sigma_grey == pytest.approx(rms(first, clean), rel=0.03)
        assert len(found.level_grey) == len(found.variance_grey2)
        assert np.all(np.diff(found.level_grey) > 0.0)


def test_the_model_is_never_below_nothing(noisy):
    found = estimate_noise(shot(Speckle(size_px=SIZE).image(), 0.0, 0.02, 1))
    assert np.all(found.variance_at(np.array([-1000.0, 0.0])) >= 0.0)


@pytest.mark.parametrize("scene", ["sphere", "membrane", "cube"])
def test_noise_of_the_twins_frames(scene):
    world = World(coarse_options(factor=2, sensor={"blur_px": 0.7}, scene=scene))
    try:
        clean = 255.0 * world.irradiance("primary")
        rng = np.random.default_rng(5)
        first, second = (world.expose("primary", exposure_s=0.02, gain_db=0.0, rng=rng) for _ in range(2))
    finally:
        world.close()
    truth = rms(first, clean)
    assert 0.8 < truth < 2.1
    assert estimate_noise(first).sigma_grey == pytest.approx(truth, rel=0.05)
    assert noise_from_pair(first, second).sigma_grey == pytest.approx(truth, rel=0.03)


def test_the_medians_of_plain_noise_are_those_of_the_plain_definition():
    image = np.random.default_rng(2).normal(100.0, 3.0, (300, 320))
    difference = np.array([1.0, -8.0, 28.0, -56.0, 70.0, -56.0, 28.0, -8.0, 1.0])
    detail = image
    for axis in (0, 1):
        detail = np.apply_along_axis(np.convolve, axis, detail, difference / np.linalg.norm(difference), "valid")
    assert estimate_noise(image).sigma_grey == pytest.approx(np.median(np.abs(detail)) / 0.6745, rel=0.02)
    assert estimate_noise(image).sigma_grey == pytest.approx(image.std(), rel=0.02)


def test_sharp_edges_between_flat_paint_are_not_taken_for_noise():
    rng = np.random.default_rng(6)
    thickness = cv2.GaussianBlur(rng.normal(0.0, 1.0, (512, 640)), (0, 0), 3.0)
    clean = 130.0 + 100.0 * np.tanh(4.0 * thickness / thickness.std())
    image = digitise(clean, 1.0, rng)
    found = estimate_noise(image)
    assert found.sigma_grey == pytest.approx(rms(image, clean), rel=0.15)
    # the mean over all levels is far off: what the line through the cleanest of them is for
    assert np.sqrt(found.variance_grey2.mean()) > 1.5 * found.sigma_grey


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int16, np.int32, np.int64, np.float32, np.float64])
def test_any_type_of_image(noisy, dtype):
    wanted = estimate_noise(noisy)
    assert estimate_noise(noisy.astype(dtype)).sigma_grey == pytest.approx(wanted.sigma_grey, rel=1e-3)
    pair = noise_from_pair(noisy.astype(dtype), noisy[::-1].astype(dtype)).sigma_grey
    assert pair == pytest.approx(noise_from_pair(noisy, noisy[::-1]).sigma_grey, rel=0.02)


def test_saturated_pixels_do_not_count(clean):
    bright = digitise(1.6 * clean, 2.0, np.random.default_rng(3))
    assert np.mean(bright == 255) > 0.15
    assert estimate_noise(bright).sigma_grey == pytest.approx(2.02, rel=0.05)
    second = digitise(1.6 * clean, 2.0, np.random.default_rng(4))
    assert noise_from_pair(bright, second).sigma_grey == pytest.approx(2.02, rel=0.03)


def test_ten_bits_in_sixteen_saturate_at_ten(clean):
    bright = np.clip(np.rint(6.4 * clean + np.random.default_rng(3).normal(0.0, 8.0, clean.shape)), 0, 1023)
    assert estimate_noise(bright.astype(np.uint16)).sigma_grey == pytest.approx(8.0, rel=0.05)


def test_only_what_the_mask_shows_counts(clean):
    rng = np.random.default_rng(9)
    image = np.hstack([digitise(clean[:, :320], 1.0, rng), digitise(clean[:, 320:], 6.0, rng)])
    again = np.hstack([digitise(clean[:, :320], 1.0, rng), digitise(clean[:, 320:], 6.0, rng)])
    left = np.zeros(image.shape, bool)
    left[:, :320] = True
    for mask, truth in ((left, 1.04), (~left, 6.01), (left.astype(np.uint8), 1.04)):
        assert estimate_noise(image, mask=mask).sigma_grey == pytest.approx(truth, rel=0.05)
        assert noise_from_pair(image, again, mask=mask).sigma_grey == pytest.approx(truth, rel=0.03)


def test_a_small_region_is_enough(clean, noisy):
    mask = np.zeros(noisy.shape, bool)
    mask[101:121, 203:231] = True
    assert estimate_noise(noisy, mask=mask).sigma_grey == pytest.approx(2.02, rel=0.4)


@settings(max_examples=15, deadline=None)
@given(gain=st.floats(0.1, 20.0), offset=st.floats(-100.0, 1000.0))
def test_a_gain_scales_the_noise_and_an_offset_does_not(noisy, gain, offset):
    wanted = estimate_noise(noisy.astype(float) + 0.5).sigma_grey
    found = estimate_noise(gain * (noisy + 0.5) + abs(offset) + offset)
    assert found.sigma_grey == pytest.approx(gain * wanted, rel=0.03)


@settings(max_examples=15, deadline=None)
@given(gain=st.floats(0.7, 1.4), offset=st.floats(-20.0, 20.0))
def test_light_may_change_between_the_images_of_a_pair(clean, gain, offset):
    rng = np.random.default_rng(11)
    first = clean + rng.normal(0.0, 2.0, clean.shape)
    second = gain * clean + offset + rng.normal(0.0, 2.0, clean.shape)
    assert noise_from_pair(first, second).sigma_grey == pytest.approx(2.0, rel=0.02)


@pytest.mark.parametrize("turn", [np.fliplr, np.flipud, np.transpose, lambda image: image[3:, 5:]])
def test_mirrored_and_shifted_images_are_as_noisy(noisy, turn):
    assert estimate_noise(turn(noisy)).sigma_grey == pytest.approx(estimate_noise(noisy).sigma_grey, rel=0.03)


def test_a_pair_is_right_where_a_single_image_is_not():
    fine = Speckle(radius_px=1.2, spots_per_px2=0.12, size_px=SIZE).image()
    rng = np.random.default_rng(2)
    smooth = [cv2.GaussianBlur(rng.normal(0.0, 5.0, fine.shape), (0, 0), 1.0) for _ in range(2)]
    truth = np.std(smooth)
    first, second = (fine + noise for noise in smooth)
    assert noise_from_pair(first, second).sigma_grey == pytest.approx(truth, rel=0.03)
    assert abs(estimate_noise(first).sigma_grey - truth) > 0.2


def test_few_moving_pixels_of_a_pair_are_left_out_and_motion_is_noise(clean):
    rng = np.random.default_rng(12)
    first, second = (digitise(clean, 2.0, rng) for _ in range(2))
    second[100:140, 100:140] = 0
    assert noise_from_pair(first, second).sigma_grey == pytest.approx(2.02, rel=0.05)
    assert noise_from_pair(first, np.roll(first, 1, axis=1)).sigma_grey > 5.0


@pytest.mark.parametrize("level", [0.5, 100.0, 3e4])
def test_an_image_of_one_level_has_no_noise(level):
    assert estimate_noise(np.full((50, 60), level)).sigma_grey == pytest.approx(0.0, abs=1e-5 * level)


@pytest.mark.parametrize(
    ("image", "mask", "says"),
    [
        (np.zeros((20, 20, 3), np.uint8), None, r"shape \(20, 20, 3\), a monochrome image"),
        (np.zeros(0), None, "a monochrome image"),
        (np.zeros((0, 5)), None, "a monochrome image"),
        (np.ones((30, 30), bool), None, "type bool are no grey levels"),
        (np.ones((30, 30), complex), None, "type complex128"),
        (np.full((30, 30), np.nan), None, "900 pixels are not finite"),
        (np.full((30, 30), 1e300), None, "900 pixels are not finite"),
        (np.full((30, 30), 255, np.uint8), None, "change the exposure"),
        (np.zeros((30, 30), np.uint8), None, "change the exposure"),
        (np.full((9, 9), 100, np.uint8), None, "fewer than 64 pixels"),
        (np.full((3, 700), 100, np.uint8), None, "fewer than 64 pixels"),
        (np.full((30, 30), 100, np.uint8), np.zeros((30, 30), bool), "widen the mask"),
        (np.full((30, 30), 100, np.uint8), np.ones((30, 31), bool), r"\(30, 31\), the image's \(30, 30\)"),
        (np.full((30, 30), 100, np.uint8), np.full((30, 30), 0.5), "not values of type float64"),
    ],
)
def test_what_can_not_be_used_is_refused(image, mask, says):
    with pytest.raises(InputError, match=says):
        estimate_noise(image, mask=mask)
    with pytest.raises(InputError, match=says):
        noise_from_pair(image, image, mask=mask)


def test_a_pair_has_one_size(noisy):
    with pytest.raises(InputError, match=r"different sizes, \(512, 640\) and \(512, 639\)"):
        noise_from_pair(noisy, noisy[:, 1:])


@pytest.mark.real_data
@pytest.mark.parametrize("file", ["201/201_1.jpg", "202/202_3.jpg"])
def test_photographs_have_a_plausible_noise(real_data, file):
    image = cv2.imread(str(real_data / "multidic-speckle" / file), cv2.IMREAD_GRAYSCALE)
    # compressed, so little is left of it at the highest frequencies
    assert 0.2 < estimate_noise(image).sigma_grey < 1.5


@pytest.mark.real_data
def test_noise_of_the_challenges_reference_grows_with_the_level(real_data):
    image = cv2.imread(str(real_data / "dic-challenge-14" / "Sample14 Reference.tif"), cv2.IMREAD_GRAYSCALE)
    found = estimate_noise(image)
    assert 1.5 < found.sigma_grey < 2.2
    assert found.slope_grey > 0.0
