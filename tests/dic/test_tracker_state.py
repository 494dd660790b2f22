"""A tracker goes on from its state, in this process or after a journey, as if nothing had happened."""

import pickle

import numpy as np
import pytest

from bscd.dic.tracker_state import REFERENCE
from bscd.dic.tracking import Tracker, TrackingSettings
from tests.dic.motions import stretch
from tests.dic.test_tracking import COVERED, NOISE, POINTS, SIZE, frame

SETTINGS = TrackingSettings(noise_grey=NOISE, lost_share=0.01)


@pytest.fixture(scope="module")
def images():
    """A stretch with something in front of it for a while, so that references are renewed and points come back."""
    covers = {1: COVERED, 2: COVERED, 4: (slice(60, 110), slice(60, 120))}
    kept = {REFERENCE: frame()}
    for number, strain in enumerate((0.03, 0.06, 0.09, 0.12, 0.15, 0.18)):
        kept[number] = frame(stretch(strain, SIZE), number + 1, covered=covers.get(number))
    return kept


def same(one, other):
    return all(np.array_equal(value, other.__dict__[name], equal_nan=True) for name, value in one.__dict__.items())


@pytest.fixture(scope="module")
def followed(images):
    points = Tracker(images[REFERENCE], POINTS, SETTINGS)
    return [points.track(images[number]) for number in range(6)]


def test_the_sequence_renews_its_reference_and_loses_points(followed):
    assert followed[-1].renewals > 1
    assert min(np.count_nonzero(found.valid) for found in followed) < len(POINTS) < 2 * followed[-1].valid.sum()


@pytest.mark.parametrize("chunk", [1, 2, 4])
def test_it_goes_on_from_its_pickled_state_bit_by_bit(images, followed, chunk):
    state = Tracker(images[REFERENCE], POINTS, SETTINGS).state()
    for first in range(0, 6, chunk):
        state = pickle.loads(pickle.dumps(state))
        known = {number: images[number] for number in state.images}
        points = Tracker.resumed(state, known, SETTINGS)
        for number in range(first, min(first + chunk, 6)):
            assert points.tracked == number
            assert same(points.track(images[number]), followed[number]), number
        state = points.state()


def test_a_state_does_not_change_when_its_tracker_goes_on(images, followed):
    points = Tracker(images[REFERENCE], POINTS, SETTINGS)
    points.track(images[0])
    state = points.state()
    for number in range(1, 6):
        points.track(images[number])
    again = Tracker.resumed(state, {number: images[number] for number in state.images}, SETTINGS)
    assert same(again.track(images[1]), followed[1])


def test_a_state_holds_no_image(images):
    points = Tracker(images[REFERENCE], POINTS, SETTINGS)
    assert points.state().images == {REFERENCE}
    for number in range(6):
        points.track(images[number])
    assert points.state().images <= {REFERENCE, *range(6)}
    assert 5 in points.state().images
    assert len(pickle.dumps(points.state())) < 800 * len(POINTS) * len(points.state().generations)
