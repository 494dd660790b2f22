"""Speckle quality: against the plain definition, the Cramer-Rao limit of exact speckles and patterns worked by hand."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bscd.dic.noise import ImageNoise
from bscd.dic.speckle import speckle_quality
from bscd.dic.speckle_size import speckle_size
from bscd.errors import InputError
from tests.dic.cramer_rao import cramer_rao_px
from tests.dic.speckle_pairs import Speckle, digitise

SIZE = (320, 256)
INNER = np.stack(np.meshgrid(np.arange(15, 305, 11), np.arange(15, 241, 11)), axis=-1).reshape(-1, 2).astype(float)
DERIVATIVE = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0


@pytest.fixture(scope="module")
def speckle():
    return Speckle(seed=4, size_px=SIZE)


@pytest.fixture(scope="module")
def noisy(speckle):
    return digitise(speckle.image(), 2.0, np.random.default_rng(1))


def plain(image, point, half, noise, mask):
    """MIG, SSSIG, sigma and pixels of one subset, as they are defined; the image is mirrored beyond its border."""
    padded = np.pad(np.asarray(image, float), 3, mode="reflect")
    along_x = sum(w * padded[3:-3, k : k + image.shape[1]] for k, w in enumerate(DERIVATIVE))
    along_y = sum(w * padded[k : k + image.shape[0], 3:-3] for k, w in enumerate(DERIVATIVE))
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    dx, dy = columns - point[0], rows - point[1]
    used = (abs(dx) <= half) & (abs(dy) <= half) & mask
    s, s_x, s_y, dx, dy = (a[used].astype(float) for a in (image, along_x, along_y, dx, dy))
    sensitivity = np.stack([s_x, s_y, s_x * dx, s_x * dy, s_y * dx, s_y * dy, s - s.mean(), np.ones_like(s)])
    hessian = sensitivity @ sensitivity.T
    known = hessian[:2, :2] - hessian[:2, 2:] @ np.linalg.solve(hessian[2:, 2:], hessian[2:, :2])
    known -= np.eye(2) * len(s) * noise**2 * np.sum(DERIVATIVE**2)
    sigma = np.sqrt(2.0 * noise**2 * np.diag(np.linalg.inv(known)))
    return np.hypot(s_x, s_y).mean(), [np.sum(s_x**2), np.sum(s_y**2)], sigma, len(s)


@pytest.mark.parametrize("subset", [11, 21, 31])
@pytest.mark.parametrize("masked", [False, True])
def test_each_subset_is_as_defined(speckle, noisy, subset, masked):
    points = np.array([[160, 128], [161, 128], [40, 200], [0, 0], [319, 255], [3, 100], [160, 250], [200, 127]], float)
    mask = np.ones(noisy.shape, bool)
    if masked:
        mask[100:127, 30:] = False
        mask[:, 165:168] = False
    image = noisy if not masked else noisy * 12.5 + 1000.0
    noise = 2.0 if not masked else 25.0
    found = speckle_quality(image, points, subset_px=subset, noise_grey=noise, mask=mask)
    for k, point in enumerate(points.astype(int)):
        mig, sssig, sigma, pixels = plain(image, point, subset // 2, noise, mask)
        assert found.mig_grey[k] == pytest.approx(mig, rel=1e-5)
        np.testing.assert_allclose(found.sssig_grey2[k], sssig, rtol=1e-5)
        np.testing.assert_allclose(found.sigma_px[k], sigma, rtol=1e-3)
        np.testing.assert_allclose(found.sigma_translation_px[k], np.sqrt(2.0) * noise / np.sqrt(sssig), rtol=1e-5)
        assert found.pixels[k] == pixels


def test_points_far_apart_are_measured_as_alone(noisy):
    rng = np.random.default_rng(3)
    tall = np.tile(noisy, (3, 1))
    points = rng.uniform(-5.0, [325.0, 773.0], (400, 2))
    together = speckle_quality(tall, points, noise_grey=2.0)
    for k in range(0, 400, 37):
        alone = speckle_quality(tall, points[k : k + 1], noise_grey=2.0)
        np.testing.assert_allclose(alone.sigma_px[0], together.sigma_px[k], rtol=1e-4)
        np.testing.assert_allclose(alone.mig_grey[0], together.mig_grey[k], rtol=1e-6)
        assert alone.pixels[0] == together.pixels[k]


def test_expected_sigma_is_the_limit_of_the_exact_pattern(speckle, noisy):
    limit = cramer_rao_px(speckle.image(), speckle.gradient(), INNER.astype(int), (2.0, 2.0))
    exact = speckle_quality(speckle.image(), INNER, noise_grey=2.0).sigma_px / limit
    measured = speckle_quality(noisy, INNER, noise_grey=2.0).sigma_px / limit
    assert np.all(abs(exact - 1.0) < 0.05)
    assert np.mean(measured) == pytest.approx(1.0, abs=0.01)
    assert np.all(abs(measured - 1.0) < 0.1)


def test_a_crossed_grating_worked_by_hand():
    # whole periods about a crest: all other derivatives are orthogonal, and the sums of squares are half the pixels
    # times the squared amplitude
    amplitude, period, subset = 50.0, 7, 21
    k = 2.0 * np.pi / period
    y, x = np.mgrid[:101, :101].astype(float)
    image = 128.0 + amplitude * (np.cos(k * x) + np.cos(k * y))
    found = speckle_quality(image, np.array([[49.0, 49.0]]), subset_px=subset, noise_grey=1.0)
    passed = 2.0 * sum(w * np.sin(k * n) for n, w in zip((1, 2, 3), DERIVATIVE[4:], strict=True))
    assert passed == pytest.approx(k, rel=0.005)
    sssig = subset**2 * (amplitude * passed) ** 2 / 2.0
    np.testing.assert_allclose(found.sssig_grey2, [[sssig, sssig]], rtol=1e-5)
    least = subset**2 * np.sum(DERIVATIVE**2)
    np.testing.assert_allclose(found.sigma_px, np.sqrt(2.0 / (sssig - least)), rtol=1e-3)


def test_the_gradient_is_exact_for_soft_speckles(speckle):
    found = speckle_quality(speckle.image(), INNER, noise_grey=1.0)
    steepness = np.hypot(*speckle.gradient())
    wanted = [steepness[y - 10 : y + 11, x - 10 : x + 11].mean() for x, y in INNER.astype(int)]
    np.testing.assert_allclose(found.mig_grey, wanted, rtol=0.01)


def test_a_constant_image_has_nothing_to_match():
    for level in (0.1, 7.0, 200.0):
        for noise in (None, 0.0, 1.0):
            found = speckle_quality(np.full((90, 100), level), np.array([[50.0, 40.0], [2.0, 2.0]]), noise_grey=noise)
            assert np.all(np.isinf(found.sigma_px))
            np.testing.assert_allclose(found.mig_grey, 0.0, atol=1e-4)
            assert found.summary.untextured_share == 1.0
            assert "100.0% of the subsets show no texture" in found.summary.advice
    assert np.all(np.isinf(found.sigma_translation_px) | (found.sigma_translation_px > 1e3))


def test_noise_is_no_texture():
    image = np.random.default_rng(5).normal(100.0, 3.0, (256, 320))
    assert np.isinf(speckle_quality(image, INNER, noise_grey=3.0).sigma_px).all(axis=1).mean() > 0.99
    assert speckle_quality(image, INNER).summary.untextured_share > 0.99


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize(("tilt_deg", "unknown"), [(0.0, [False, True]), (90.0, [True, False]), (40.0, [True, True])])
def test_stripes_place_a_subset_across_them_only(noise, tilt_deg, unknown):
    y, x = np.mgrid[:120, :120].astype(float)
    across = x * np.cos(np.radians(tilt_deg)) + y * np.sin(np.radians(tilt_deg))
    image = 128.0 + 60.0 * np.sin(across) + np.random.default_rng(1).normal(0.0, noise, x.shape)
    found = speckle_quality(image, np.array([[60.0, 60.0], [33.0, 71.0]]), noise_grey=noise)
    np.testing.assert_array_equal(np.isinf(found.sigma_px), [unknown, unknown])
    finite = found.sigma_px[np.isfinite(found.sigma_px)]
    assert np.all(finite == 0.0) if noise == 0.0 else np.all((finite > 0.001) & (finite < 0.003))


def test_a_ramp_is_a_change_of_the_offset():
    image = np.arange(100.0)[None, :] + 2.0 * np.arange(90.0)[:, None]
    assert np.all(np.isinf(speckle_quality(image, np.array([[50.0, 45.0]]), noise_grey=0.1).sigma_px))


def test_points_off_the_image_or_masked_have_no_figures(noisy):
    mask = np.ones(noisy.shape, bool)
    mask[:, :100] = False
    points = np.array(
        [[200, 100], [50, 100], [-1, 5], [320, 5], [5, 256], [np.nan, 5], [np.inf, 5], [-1e300, 5], [319.4, 255.4]]
    )
    found = speckle_quality(noisy, points, mask=mask)
    known = np.array([True, False, False, False, False, False, False, False, True])
    for figures in (found.mig_grey, found.noise_grey, found.saturated_share, found.sigma_px[:, 0]):
        np.testing.assert_array_equal(np.isfinite(figures), known)
    np.testing.assert_array_equal(np.isnan(found.sigma_translation_px[:, 1]), ~known)
    np.testing.assert_array_equal(found.pixels, [441, 0, 0, 0, 0, 0, 0, 0, 121])


def test_no_points_have_no_figures_and_the_advice_says_so(noisy):
    for points in (np.empty((0, 2)), np.array([[-5.0, -5.0]])):
        found = speckle_quality(noisy, points)
        assert found.sigma_px.shape == (len(points), 2)
        assert np.isnan(found.summary.sigma_px)
        assert found.summary.advice == "no point is on the image and its mask"


@settings(max_examples=20, deadline=None)
@given(
    points=arrays(float, st.tuples(st.integers(0, 30), st.just(2)), elements=st.floats(width=32) | st.floats(-9, 330))
)
def test_any_points_get_an_answer(noisy, points):
    found = speckle_quality(noisy, points, noise_grey=2.0)
    inside = ((np.rint(points) >= 0) & (np.rint(points) < SIZE)).all(axis=1)
    np.testing.assert_array_equal(np.isnan(found.mig_grey), ~inside)
    assert np.all(found.sigma_px[inside] > 0.0)


@settings(max_examples=15, deadline=None)
@given(gain=st.floats(0.01, 100.0), offset=st.floats(0.0, 1000.0))
def test_gain_and_offset_do_not_change_what_can_be_matched(noisy, gain, offset):
    wanted = speckle_quality(noisy, INNER, noise_grey=2.0)
    found = speckle_quality(gain * noisy + offset, INNER, noise_grey=2.0 * gain)
    np.testing.assert_allclose(found.sigma_px, wanted.sigma_px, rtol=0.02)
    np.testing.assert_allclose(found.mig_grey, gain * wanted.mig_grey, rtol=0.002)


@settings(max_examples=10, deadline=None)
@given(dx=st.integers(-12, 12), dy=st.integers(-12, 12))
def test_shifted_images_are_the_same_elsewhere(noisy, dx, dy):
    points = INNER[(np.abs(INNER - [160, 128]) < [120, 90]).all(axis=1)]
    wanted = speckle_quality(noisy, points, noise_grey=2.0)
    found = speckle_quality(np.roll(noisy, (dy, dx), axis=(0, 1)), points + [dx, dy], noise_grey=2.0)
    np.testing.assert_allclose(found.sigma_px, wanted.sigma_px, rtol=1e-4)


def test_mirrored_and_transposed_images_mirror_the_figures(noisy):
    wanted = speckle_quality(noisy, INNER, noise_grey=2.0)
    mirrored = speckle_quality(noisy[:, ::-1], [319.0, 0.0] + INNER * [-1.0, 1.0], noise_grey=2.0)
    np.testing.assert_allclose(mirrored.sigma_px, wanted.sigma_px, rtol=1e-4)
    transposed = speckle_quality(noisy.T, INNER[:, ::-1], noise_grey=2.0)
    np.testing.assert_allclose(transposed.sigma_px, wanted.sigma_px[:, ::-1], rtol=1e-4)
    np.testing.assert_allclose(transposed.sssig_grey2, wanted.sssig_grey2[:, ::-1], rtol=1e-5)


def test_noise_that_grows_with_the_level_is_taken_at_the_subsets_level(noisy):
    model = ImageNoise(1.0, 0.5, 0.02, np.array([0.0, 200.0]), np.array([0.5, 4.5]), 1000)
    found = speckle_quality(noisy, INNER, noise_grey=model)
    level = np.array([noisy[y - 10 : y + 11, x - 10 : x + 11].mean() for x, y in INNER.astype(int)])
    np.testing.assert_allclose(found.noise_grey, np.sqrt(0.5 + 0.02 * level), rtol=1e-5)
    estimated = speckle_quality(noisy, INNER)
    np.testing.assert_allclose(estimated.noise_grey, 2.02, rtol=0.06)


def test_saturated_pixels_are_counted(noisy):
    image = noisy.copy()
    image[100:120, 100:110] = 255
    image[100:105, 110:120] = 0
    found = speckle_quality(image, np.array([[110.0, 110.0], [200.0, 200.0]]), noise_grey=2.0)
    window = image[100:121, 100:121]
    np.testing.assert_allclose(found.saturated_share, [np.mean((window == 0) | (window == 255)), 0.0])


def random_field(sigma_px, shape, seed):
    """White noise under a Gaussian of these sigmas (x, y); the autocorrelation's is sqrt(2) wider."""
    fy, fx = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None, :]
    white = np.fft.rfft2(np.random.default_rng(seed).normal(size=shape))
    field = np.fft.irfft2(white * np.exp(-2.0 * np.pi**2 * ((fx * sigma_px[0]) ** 2 + (fy * sigma_px[1]) ** 2)), shape)
    return 100.0 + 25.0 * field / field.std()


@pytest.mark.parametrize("sigma_px", [(0.5, 0.5), (0.9, 0.9), (1.6, 1.6), (1.2, 2.4)])
@pytest.mark.parametrize("noise", [0.0, 6.0])
def test_size_of_a_random_field_of_known_correlation(sigma_px, noise):
    image = random_field(sigma_px, (256, 320), 3) + np.random.default_rng(4).normal(0.0, noise, (256, 320))
    size = speckle_size(image, INNER, noise_grey=noise)
    wanted = 2.0 * np.sqrt(2.0 * np.log(2.0)) * np.sqrt(2.0) * np.array(sigma_px)
    np.testing.assert_allclose(np.median(size, axis=0), wanted, rtol=0.05)


def test_size_of_one_window_as_defined(noisy):
    mask = np.ones(noisy.shape, bool)
    mask[90:100, 150:] = False
    point, window, noise = (160.0, 110.0), 48, 2.0
    found = speckle_size(noisy, np.array([point]), window_px=window, noise_grey=noise, mask=mask)[0]
    part = slice(110 - 24, 110 + 24), slice(160 - 24, 160 + 24)
    grey, used = noisy[part].astype(float), mask[part].astype(float)
    for size, s, w in zip(found, (grey, grey.T), (used, used.T), strict=True):
        s = (s - (s * w).sum() / w.sum()) * w
        covariance = [np.sum(s[:, : window - k] * s[:, k:]) / np.sum(w[:, : window - k] * w[:, k:]) for k in range(24)]
        height = np.array(covariance) / (covariance[0] - noise**2)
        height[0] = 1.0
        lag = np.flatnonzero(height < 0.5)[0]
        square = np.interp(-np.log(0.5), -np.log(height[lag - 1 : lag + 1]), [(lag - 1.0) ** 2, lag**2])
        assert size == pytest.approx(2.0 * np.sqrt(square), rel=1e-4)


def test_size_where_there_is_none(noisy):
    points = np.array([[60.0, 60.0], [-3.0, 5.0], [np.nan, 1.0]])
    assert np.all(np.isnan(speckle_size(np.full((120, 120), 9.0), points)))
    sizes = speckle_size(np.arange(120.0)[None, :] + np.zeros((120, 1)), points)
    assert sizes[0, 0] > 20.0  # a ramp is as wide as the window lets it
    assert np.isinf(sizes[0, 1])
    assert np.all(np.isnan(sizes[1:]))
    white = np.random.default_rng(1).normal(0.0, 3.0, (120, 120))
    assert np.all(np.isnan(speckle_size(white, points, noise_grey=3.0)))
    assert speckle_size(noisy, np.empty((0, 2))).shape == (0, 2)


def test_summary_of_a_good_pattern(noisy):
    summary = speckle_quality(noisy, INNER).summary
    np.testing.assert_allclose(summary.speckle_px, 2.355 * 2.6, rtol=0.05)
    assert summary.noise_grey == pytest.approx(2.02, rel=0.05)
    assert 0.005 < summary.sigma_px < 0.008
    assert (summary.untextured_share, summary.saturated_share) == (0.0, 0.0)
    assert summary.advice.startswith("good: speckles 6.")


def fine():
    return digitise(Speckle(radius_px=0.8, spots_per_px2=0.27, size_px=SIZE).image(), 1.0, np.random.default_rng(1))


def coarse():
    return digitise(Speckle(radius_px=5.0, spots_per_px2=0.007, size_px=SIZE).image(), 1.0, np.random.default_rng(1))


def pale():
    image = Speckle(size_px=SIZE, dark_grey=95.0, bright_grey=112.0).image()
    return digitise(image, 2.0, np.random.default_rng(1))


def glaring():
    return digitise(1.5 * Speckle(size_px=SIZE).image(), 2.0, np.random.default_rng(1))


def half_bare():
    image = Speckle(size_px=SIZE).image()
    image[:, 200:] = 150.0
    return digitise(image, 2.0, np.random.default_rng(1))


@pytest.mark.parametrize(
    ("image", "says"),
    [
        (fine, r"speckles are [12]\.\d px wide: below 3 px interpolation errors grow"),
        (coarse, r"speckles are 1\d\.\d px wide: a subset of 21 px holds too few"),
        (pale, r"expected sigma 0\.\d+ px: more contrast, less noise or a larger subset"),
        (glaring, r"\d+\.\d% of the pixels are saturated"),
        (half_bare, r"\d+\.\d% of the subsets show no texture above the noise"),
    ],
)
def test_advice_names_what_limits_the_match(image, says):
    summary = speckle_quality(image(), INNER, noise_grey=2.0).summary
    assert re.search(says, summary.advice), summary.advice
    assert "good" not in summary.advice


NOT_A_POINT = np.zeros((3, 3))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"subset_px": 20}, "is 20, an odd number"),
        ({"subset_px": 1}, "is 1, an odd number"),
        ({"subset_px": -3}, "is -3, an odd number"),
        ({"subset_px": 21.0}, "is 21.0, an odd number"),
        ({"subset_px": 257}, "257 does not fit into an image of 320 x 256 px"),
        ({"points_px": NOT_A_POINT}, r"shape \(3, 3\)"),
        ({"points_px": np.zeros(2)}, r"shape \(2,\)"),
        ({"points_px": np.zeros((4, 2), complex)}, "complex128, real numbers"),
        ({"noise_grey": -1.0}, "noise_grey: is -1.0"),
        ({"noise_grey": np.nan}, "noise_grey: is nan"),
        ({"mask": np.ones((3, 3), bool)}, r"mask: its shape is \(3, 3\)"),
        ({"mask": np.zeros((256, 320), bool)}, "widen the mask"),
        ({"image": np.zeros((64, 64, 3))}, "a monochrome image"),
        ({"image": np.full((64, 64), np.inf)}, "not finite"),
    ],
)
def test_what_can_not_be_used_is_refused(noisy, change, says):
    given_all = {"image": noisy, "points_px": INNER} | change
    with pytest.raises(InputError, match=says):
        speckle_quality(**given_all)


@pytest.mark.parametrize(
    ("change", "says"),
    [({"window_px": 7}, "is 7; 8 to 256 px"), ({"window_px": 300}, "is 300; 8 to 256"), ({"noise_grey": -1.0}, "-1.0")],
)
def test_windows_that_can_not_be_used_are_refused(noisy, change, says):
    with pytest.raises(InputError, match=says):
        speckle_size(noisy, INNER, **change)


@pytest.mark.real_data
def test_a_photograph_of_speckles(real_data):
    image = cv2.imread(str(real_data / "multidic-speckle/201/201_1.jpg"), cv2.IMREAD_GRAYSCALE)
    x, y = np.meshgrid(np.arange(1000.0, 1500.0, 20.0), np.arange(1500.0, 2000.0, 20.0))
    found = speckle_quality(image, np.column_stack([x.ravel(), y.ravel()]), subset_px=41)
    assert np.isfinite(found.sigma_px).mean() > 0.9
    assert 0.0005 < found.summary.sigma_px < 0.05
    assert 3.0 < min(found.summary.speckle_px) < max(found.summary.speckle_px) < 40.0
