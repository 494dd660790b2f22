"""The covariance of a point's two images against the same in plain NumPy."""

from __future__ import annotations

import numpy as np

from bscd.procedures.measuring.uncertainty_kernel import both_views, half_sum_and_difference, image_covariances

RNG = np.random.default_rng(12)
COUNT = 50


def covariances() -> np.ndarray:
    spread = RNG.normal(size=(COUNT, 2, 2))
    return spread @ np.swapaxes(spread, 1, 2) + 0.1 * np.eye(2)


def turned(matrices: np.ndarray) -> np.ndarray:
    return np.swapaxes(matrices, 1, 2)


LEFT_GRADIENT, RIGHT_GRADIENT, STEREO_GRADIENT = 0.2 * RNG.normal(size=(3, COUNT, 2, 2))
LEFT_REFERENCE, RIGHT_REFERENCE, STEREO = covariances(), covariances(), 5.0 * covariances()
LEFT, RIGHT = LEFT_REFERENCE + covariances(), RIGHT_REFERENCE + covariances()
ALIKE, APART = RNG.uniform(1.0, 4.0, (2, COUNT))
ONWARD = np.eye(2) + RIGHT_GRADIENT
ACROSS = ONWARD @ (np.eye(2) + STEREO_GRADIENT) @ np.linalg.inv(np.eye(2) + LEFT_GRADIENT)
BOTH = ACROSS @ LEFT @ turned(ACROSS) + RIGHT


def test_both_views():
    across, both = np.empty((2, COUNT, 2, 2))
    both_views(LEFT_GRADIENT, RIGHT_GRADIENT, STEREO_GRADIENT, LEFT, RIGHT, across, both)
    np.testing.assert_allclose(across, ACROSS, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(both, BOTH, rtol=1e-9, atol=1e-12)


def test_half_sum_and_difference():
    moved, other, middle, difference = RNG.normal(size=(4, COUNT, 2))
    half_sum_and_difference(ACROSS, moved, other, middle, difference)
    mine = np.einsum("nij,nj->ni", ACROSS, moved)
    np.testing.assert_allclose(middle, (mine + other) / 2.0, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(difference, other - mine, rtol=1e-12, atol=1e-12)


def test_image_covariances():
    tracking, position = np.empty((2, COUNT, 4, 4))
    image_covariances(
        ACROSS,
        BOTH,
        ONWARD,
        ALIKE,
        APART,
        LEFT,
        LEFT_REFERENCE,
        RIGHT,
        RIGHT_REFERENCE,
        STEREO,
        tracking,
        position,
    )
    expected = scatter()
    expected[:, :2, :2] += LEFT
    with_right = expected.copy()
    with_right[:, 2:, 2:] += RIGHT
    np.testing.assert_allclose(tracking, with_right, rtol=1e-9, atol=1e-9)
    shared = ACROSS @ LEFT_REFERENCE
    expected[:, 2:, :2] += shared
    expected[:, :2, 2:] += turned(shared)
    expected[:, 2:, 2:] += shared @ turned(ACROSS) + RIGHT - RIGHT_REFERENCE
    same = shared @ turned(ACROSS) + RIGHT_REFERENCE
    own = ONWARD @ STEREO @ turned(ONWARD)
    times = np.trace(np.linalg.solve(same, own), axis1=1, axis2=2) / 2.0
    expected[:, 2:, 2:] += np.maximum(times / APART - 1.0, 0.0)[:, None, None] * same
    np.testing.assert_allclose(position, expected, rtol=1e-9, atol=1e-9)
    assert (times > APART).any()
    assert (times < APART).any()


def scatter() -> np.ndarray:
    """Covariance ``(N, 4, 4)`` of the errors beyond the noise in both views, by half their sum and their difference."""
    back = np.linalg.inv(ACROSS)
    # right = half sum + difference / 2, left, as the right view sees it, = half sum - difference / 2
    middle, apart = (BOTH / 4.0 * (ALIKE - 1.0)[:, None, None], BOTH * (APART - 1.0)[:, None, None])
    right, common = middle + apart / 4.0, middle - apart / 4.0
    whole = np.empty((COUNT, 4, 4))
    whole[:, 2:, 2:], whole[:, :2, :2] = right, back @ right @ turned(back)
    whole[:, 2:, :2] = common @ turned(back)
    whole[:, :2, 2:] = turned(whole[:, 2:, :2])
    return whole


def test_what_is_not_known_stays_unknown():
    left = LEFT.copy()
    left[3] = np.nan
    both = ACROSS @ left @ turned(ACROSS) + RIGHT
    tracking, position = np.empty((2, COUNT, 4, 4))
    image_covariances(
        ACROSS, both, ONWARD, ALIKE, APART, left, LEFT_REFERENCE, RIGHT, RIGHT_REFERENCE, STEREO, tracking, position
    )
    assert np.isnan(position[3]).any()
    assert np.isfinite(np.delete(position, 3, axis=0)).all()
