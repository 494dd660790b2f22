"""The correlator on pairs with exact truth: how accurate it is and how sure."""

from __future__ import annotations

import numpy as np
import pytest

from bscd.dic import correlate, grid_points
from tests.dic.cramer_rao import cramer_rao_px
from tests.dic.exact_pairs import GROSS_PX, MOTIONS, NOISE, SIZE, off_px, pair, points, seen, shown, speckle
from tests.dic.motions import FloatArray, Motion, rotation, sinusoid, stretch, translation
from tests.dic.speckle_pairs import Speckle


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
