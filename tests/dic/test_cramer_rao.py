"""The noise limit against a case worked by hand and against what a least-squares fit of the exact pattern reaches."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from tests.dic.cramer_rao import cramer_rao_px
from tests.dic.speckle_pairs import Speckle

POINT = np.array([[40, 38]])


def test_a_grating_of_whole_periods():
    # s = A (cos kx + cos ky) over whole periods: s_x is orthogonal to every other derivative but s_x dx and
    # s_x dy, which vanish against it by symmetry, and s_y dx, which is orthogonal as sin ky sums to zero
    subset, period, amplitude = 21, 7, 50.0
    k = 2 * np.pi / period
    y, x = np.mgrid[-10:11, -10:11].astype(float)
    image = amplitude * (np.cos(k * x) + np.cos(k * y)) + 100.0
    gradient = np.stack([-amplitude * k * np.sin(k * x), -amplitude * k * np.sin(k * y)])
    limit = cramer_rao_px(image, gradient, np.array([[10, 10]]), (3.0, 4.0), subset)
    wanted = 5.0 / np.sqrt(subset * subset * (amplitude * k) ** 2 / 2)
    np.testing.assert_allclose(limit, [[wanted, wanted]], rtol=1e-12)


def test_the_more_is_unknown_the_higher_the_limit():
    speckle = Speckle(seed=2, size_px=(80, 76))
    limit = cramer_rao_px(speckle.image(), speckle.gradient(), POINT, (2.0, 2.0))[0]
    s_x, s_y = speckle.gradient()[:, 28:49, 30:51]
    known_shape = np.sqrt(8.0) / np.sqrt([np.sum(s_x**2), np.sum(s_y**2)])
    assert np.all(limit > known_shape)
    assert np.all(limit < 1.5 * known_shape)


def test_a_fit_of_the_exact_pattern_reaches_the_limit():
    speckle = Speckle(seed=2, size_px=(80, 76))
    noise = 2.0
    limit = cramer_rao_px(speckle.image(), speckle.gradient(), POINT, (0.0, noise))[0]
    dy, dx = np.mgrid[-10:11, -10:11].astype(float)
    near = speckle.spots[np.abs(speckle.spots[:, :2] - POINT).max(axis=1) < 28]

    def shown(p):
        x = POINT[0, 0] + dx + p[0] + p[1] * dx + p[2] * dy
        y = POINT[0, 1] + dy + p[3] + p[4] * dx + p[5] * dy
        spots = near[:, 3, None, None] * np.exp(
            -((x - near[:, 0, None, None]) ** 2 + (y - near[:, 1, None, None]) ** 2) / near[:, 2, None, None] ** 2
        )
        bare = np.prod(1.0 - spots, axis=0)
        return (p[6] * (25.0 + 205.0 * (1.0 - bare)) + 100.0 * p[7]).ravel()

    start = np.array([0, 0, 0, 0, 0, 0, 1, 0], dtype=float)
    exact, rng = shown(start), np.random.default_rng(4)
    found = []
    for _ in range(300):
        measured = exact + rng.normal(0.0, noise, exact.shape)
        fit = least_squares(lambda p, measured=measured: shown(p) - measured, start, method="lm", max_nfev=60)
        found.append(fit.x[[0, 3]])
    # a standard deviation from 300 samples is itself known to 4 %
    np.testing.assert_allclose(np.std(found, axis=0), limit, rtol=0.1)
    assert np.mean(found, axis=0) == pytest.approx(0.0, abs=4 * limit.max() / np.sqrt(300))
