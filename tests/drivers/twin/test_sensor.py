"""Image formation: noise at its stated level, exposure, gain, saturation, bits, blur."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from drivers.twin.optics import LOOKING_ALONG_Y, CameraOptics
from drivers.twin.options import SensorOptions
from drivers.twin.sensor import blur, digitise, vignette


def flat(level, shape=(400, 500)):
    return np.full(shape, level, np.float32)


def expose(level, *, exposure_s=0.02, gain_db=0.0, seed=1, **options):
    sensor = SensorOptions(**options)
    rng = np.random.default_rng(seed)
    return digitise(flat(level), sensor, exposure_s=exposure_s, gain_db=gain_db, rng=rng)


def test_noise_has_its_stated_level_at_the_working_level_and_less_in_the_dark():
    quantisation = 1.0 / 12.0
    bright, dark = expose(0.7), expose(0.1)
    assert bright.dtype == np.uint8
    assert bright.mean() == pytest.approx(0.7 * 255, abs=0.02)
    assert bright.var() == pytest.approx(2.0**2 + quantisation, rel=0.02)
    # shot noise goes with the level, read noise (0.5) does not
    assert dark.var() == pytest.approx((2.0**2 - 0.5**2) / 7.0 + 0.5**2 + quantisation, rel=0.02)


def test_gaussian_noise_is_the_same_at_every_level():
    for level in (0.1, 0.7):
        image = expose(level, noise="gaussian", noise_grey=3.0)
        assert image.var() == pytest.approx(9.0 + 1.0 / 12.0, rel=0.02)


def test_exposure_and_gain_scale_the_signal_and_gain_amplifies_shot_noise():
    assert expose(0.35, exposure_s=0.04, noise_grey=0.0).max() == round(0.7 * 255)
    assert expose(0.35, gain_db=20 * np.log10(2.0), noise_grey=0.0).max() == round(0.7 * 255)
    long, amplified = expose(0.35, exposure_s=0.04), expose(0.35, gain_db=20 * np.log10(2.0))
    assert long.var() == pytest.approx(4.0 + 1.0 / 12.0, rel=0.03)
    assert amplified.var() == pytest.approx(2.0 * 3.75 + 4.0 * 0.25 + 1.0 / 12.0, rel=0.03)


def test_too_much_light_saturates():
    assert np.all(expose(0.7, exposure_s=0.2) == 255)
    assert np.all(expose(0.7, exposure_s=0.0, noise_grey=0.0) == 0)


def test_more_bits_resolve_more():
    image = expose(0.5, bits=12, noise_grey=0.0)
    assert image.dtype == np.uint16
    assert image.max() == round(0.5 * 4095)
    noisy = expose(0.7, bits=12)
    assert noisy.std() == pytest.approx(2.0 * 4095 / 255, rel=0.02)


def test_the_same_seed_gives_the_same_noise_and_another_seed_another():
    np.testing.assert_array_equal(expose(0.7, seed=3), expose(0.7, seed=3))
    assert (expose(0.7, seed=3) != expose(0.7, seed=4)).mean() > 0.5


def test_blur_is_a_gaussian_that_moves_nothing():
    image = np.zeros((41, 51), np.float32)
    image[20, 25] = 1.0
    spread = blur(image, 0.7)
    np.testing.assert_allclose(spread, gaussian_filter(image, 0.7, truncate=6.0), atol=2e-6)
    assert spread.sum() == pytest.approx(1.0, abs=1e-6)
    assert blur(image, 0.0) is image


def test_vignetting_falls_off_from_the_principal_point():
    camera = CameraOptics(75.0, 0.0067, 301, 401, (150.0, 200.0), (0.0,) * 4, (0.0, 0.0, 0.0), LOOKING_ALONG_Y)
    light = vignette(camera, 0.2)
    assert light[200, 150] == 1.0
    assert light[0, 0] == pytest.approx(0.8, abs=0.002)
    assert light[200, 0] == pytest.approx(1.0 - 0.2 * 150**2 / (150**2 + 200**2), abs=0.002)
