"""The ellipse fit on dots drawn here, pixel by pixel from fine samples."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from bscd.calibration.dots.ellipse import CENTROID_SIGMA_PX, fit_ellipses

FINE = 16
SIZE = 48


def dot(centre, axes, angle_deg, slope=(0.0, 0.0), white=180.0, dark=40.0, blur_px=0.6):
    """An exact image ``(48, 48)`` of an ellipse with semi-axes (px) under a plane of light."""
    at = (np.arange(SIZE * FINE) + 0.5) / FINE - 0.5
    x, y = np.meshgrid(at - centre[0], at - centre[1])
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    inside = ((c * x + s * y) / axes[0]) ** 2 + ((-s * x + c * y) / axes[1]) ** 2 < 1.0
    light = 1.0 + slope[0] * (x + centre[0] - SIZE / 2) + slope[1] * (y + centre[1] - SIZE / 2)
    fine = np.where(inside, dark, white) * light
    fine = gaussian_filter(fine, blur_px * FINE, mode="nearest", truncate=5.0)
    return fine.reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))


def shape_of(axes, angle_deg):
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    turn = np.array([[c, -s], [s, c]])
    return turn @ np.diag(np.square(axes)) @ turn.T


def limits(height=SIZE, width=SIZE):
    return np.tile([0.0, width - 1.0], (height, 1))


CASES = [
    ((23.3, 24.8), (9.0, 9.0), 0.0, (0.0, 0.0), 0.6),
    ((23.3, 24.8), (9.0, 6.4), 80.0, (0.004, -0.002), 0.6),
    ((24.5, 23.1), (9.0, 4.0), 95.0, (0.003, 0.006), 0.8),
    ((22.9, 23.6), (5.0, 4.0), 30.0, (-0.005, 0.0), 1.2),
    ((24.0, 24.0), (12.0, 11.0), 10.0, (0.01, 0.01), 2.0),
]


@pytest.mark.parametrize(("centre", "axes", "angle", "slope", "blur"), CASES)
def test_centre_without_noise(centre, axes, angle, slope, blur):
    image = dot(centre, axes, angle, slope, blur_px=blur).astype(np.float32)
    start = np.array(centre) + np.array([0.6, -0.5])
    fit = fit_ellipses(image, start[None], 1.15 * shape_of(axes, angle)[None], limits())
    assert fit.fitted[0]
    assert np.abs(fit.xy_px[0] - centre).max() < 0.003
    assert np.sqrt(np.linalg.det(fit.shape[0])) == pytest.approx(axes[0] * axes[1], rel=0.1)


def test_the_plane_of_light_is_what_keeps_the_centre():
    """Half a percent of light per pixel would move a plain centroid by more than 0.05 px."""
    centre = (23.37, 24.21)
    image = dot(centre, (9.0, 9.0), 0.0, (0.005, 0.0)).astype(np.float32)
    y, x = np.mgrid[:SIZE, :SIZE]
    weight = np.clip(180.0 - image, 0, None) * (np.hypot(x - centre[0], y - centre[1]) < 12)
    assert abs((weight * x).sum() / weight.sum() - centre[0]) > 0.05
    fit = fit_ellipses(image, np.array([[23.0, 24.0]]), shape_of((9, 9), 0)[None], limits())
    assert np.abs(fit.xy_px[0] - centre).max() < 0.003


def test_sigma_is_the_scatter():
    rng = np.random.default_rng(3)
    centre = (23.37, 24.21)
    clean = dot(centre, (8.0, 8.0), 0.0)
    count = 300
    stack = np.concatenate([clean + rng.normal(0, 2.0, clean.shape) for _ in range(count)])
    image = np.clip(np.rint(stack), 0, 255).astype(np.uint8)
    start = np.stack([np.full(count, 23.4), 24.2 + SIZE * np.arange(count)], axis=1)
    fit = fit_ellipses(image, start, np.tile(shape_of((8, 8), 0), (count, 1, 1)), limits(SIZE * count))
    error = fit.xy_px - np.stack([np.full(count, centre[0]), centre[1] + SIZE * np.arange(count)], axis=1)
    assert fit.fitted.all()
    assert np.abs(error.mean(axis=0)).max() < 0.002
    assert error.std() == pytest.approx(np.sqrt((fit.sigma_px**2).mean()), rel=0.15)


def test_a_window_cut_on_one_side_does_not_bias():
    centre = (23.3, 24.8)
    image = dot(centre, (8.0, 8.0), 0.0).astype(np.float32)
    image[:, 33:] = 5.0
    bounds = limits()
    bounds[:, 1] = 32.0
    fit = fit_ellipses(image, np.array([[23.0, 25.0]]), shape_of((8, 8), 0)[None], bounds)
    assert np.abs(fit.xy_px[0] - centre).max() < 0.003
    assert 0.7 < fit.seen[0] < 1.0


def test_what_is_no_dot_keeps_a_centroid_with_a_stated_sigma():
    flat = np.random.default_rng(0).normal(100, 2, (SIZE, SIZE)).astype(np.float32)
    fit = fit_ellipses(flat, np.array([[24.0, 24.0]]), shape_of((8, 8), 0)[None], limits())
    assert not fit.fitted[0] or fit.contrast[0] < 0.1 or fit.sigma_px[0] > 0.1
    nothing = fit_ellipses(flat, np.array([[-400.0, 24.0]]), shape_of((8, 8), 0)[None], limits())
    assert not nothing.fitted[0]
    assert nothing.seen[0] == 0.0
    split = dot((24.0, 24.0), (8.0, 8.0), 0.0).astype(np.float32)
    split[:, 24:] = 180.0
    half = fit_ellipses(split, np.array([[24.0, 24.0]]), shape_of((8, 8), 0)[None], limits())
    assert half.sigma_px[0] == CENTROID_SIGMA_PX or half.residual[0] > 5.0 or half.xy_px[0, 0] < 23.0
