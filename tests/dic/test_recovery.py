"""A surface that is gone for a while, hidden or blurred, is found again at the first frame that shows it."""

import cv2
import numpy as np
import pytest

from bscd.dic import Status, grid_points, prepare
from bscd.dic.sharpness import sharpness_per_px
from bscd.dic.tracking import Tracker, TrackingSettings
from tests.dic.motions import Affine, translation
from tests.dic.speckle_pairs import Speckle, digitise

SIZE = (440, 400)
NOISE = 2.0
SPECKLE, OTHER = (Speckle(seed=seed, size_px=SIZE) for seed in (5, 6))
POINTS = grid_points((SIZE[1], SIZE[0]), 10, margin_px=90)
STILL = translation(0.0, 0.0)
TURNED = Affine(((0.985, -0.174), (0.174, 0.985)), (35.0, -40.0), (220.0, 200.0))


def grey(motion=STILL, number=0, speckle=SPECKLE, blur_px=0.0):
    image = speckle.image(motion)
    if blur_px:
        image = cv2.GaussianBlur(image, (0, 0), blur_px)
    return digitise(image, NOISE, np.random.default_rng([8, number]))


def frame(*args, **kwargs):
    return prepare(grey(*args, **kwargs))


def hidden(kind, number):
    image = {
        "nothing": lambda: digitise(np.full(SIZE[::-1], 60.0), NOISE, np.random.default_rng([9, number])),
        "black": lambda: np.zeros(SIZE[::-1], np.uint8),
        "another surface": lambda: grey(number=number, speckle=OTHER),
        "out of focus": lambda: grey(number=number, blur_px=8.0),
    }[kind]()
    return prepare(image)


def tracker():
    return Tracker(frame(), POINTS, TrackingSettings(noise_grey=NOISE))


def largest_error_px(found, motion):
    return float(np.abs(found.position_px - POINTS - motion.displacement_px(POINTS)).max())


KINDS = ["nothing", "black", "another surface", "out of focus"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("back", [STILL, translation(43.0, -38.0), TURNED], ids=["at rest", "moved", "turned"])
@pytest.mark.parametrize("frames", [1, 3])
def test_it_is_found_at_once_when_it_is_back(kind, back, frames):
    points = tracker()
    assert points.track(frame(translation(2.0, 1.0), 1)).valid.all()
    for number in range(frames):
        gone = points.track(hidden(kind, number))
        assert not gone.valid.any()
        assert np.isnan(gone.position_px).all()
    found = points.track(frame(back, 2))
    assert found.valid.mean() > 0.98
    assert np.nanmax(np.abs(found.position_px - POINTS - back.displacement_px(POINTS))) < 0.5


@pytest.mark.parametrize("kind", KINDS)
def test_only_a_few_points_are_tried_while_it_is_gone(kind):
    points = tracker()
    first = points.track(hidden(kind, 0))
    second = points.track(hidden(kind, 1))
    assert np.mean(first.status == Status.NO_GUESS) < 0.1
    assert np.mean(second.status == Status.NO_GUESS) > 0.7
    assert (second.status != Status.VALID).all()


def test_a_part_that_is_hidden_does_not_hinder_the_rest():
    points = tracker()
    for number in range(3):
        image = grey(translation(3.0 * number, 0.0), number)
        image[:, 230:] = 120
        found = points.track(prepare(image))
        seen = POINTS[:, 0] + 3.0 * number < 230 - 12
        assert found.valid[seen].all()
        assert not found.valid[POINTS[:, 0] + 3.0 * number > 230 + 8].any()
    assert points.track(frame(translation(9.0, 0.0), 3)).valid.all()


class TestBlurredFrames:
    def test_become_no_reference(self):
        points = tracker()
        blurred = points.track(frame(translation(1.0, 0.0), 1, blur_px=3.0))
        found = points.track(frame(translation(2.0, 0.0), 2))
        assert found.renewals == 0
        assert found.valid.all()
        assert blurred.valid.any()
        assert largest_error_px(found, translation(2.0, 0.0)) < 0.2

    def test_that_go_on_become_one(self):
        points = tracker()
        renewals = [points.track(frame(STILL, number, blur_px=3.0)).renewals for number in range(5)]
        assert renewals[:3] == [0, 0, 0]
        assert renewals[-1] == 1


class TestSharpness:
    def test_is_that_of_a_wave(self):
        """A wave of period p has the slope 2 pi / p of its amplitude; Sobel's differences see sin(2 pi / p)."""
        wave = np.tile(100.0 + 50.0 * np.sin(2.0 * np.pi * np.arange(300) / 20.0), (200, 1)).astype(np.float32)
        points = grid_points(wave.shape, 10, margin_px=30)
        assert sharpness_per_px(prepare(wave), points, 21) == pytest.approx(np.sin(2.0 * np.pi / 20.0), rel=0.05)

    def test_does_not_depend_on_light(self):
        bright, dark = grey(), digitise(0.3 * SPECKLE.image(STILL) + 20.0, 0.6, np.random.default_rng(3))
        one, other = (sharpness_per_px(prepare(image), POINTS, 21) for image in (bright, dark))
        assert one == pytest.approx(other, rel=0.03)

    def test_falls_with_blur(self):
        values = [sharpness_per_px(frame(blur_px=blur_px), POINTS, 21) for blur_px in (0.0, 1.0, 2.0, 4.0)]
        assert values == sorted(values, reverse=True)
        assert values[2] < 0.87 * values[0]

    def test_of_no_points_is_not_known(self):
        assert np.isnan(sharpness_per_px(frame(), np.empty((0, 2)), 21))
