"""Points are lost frame by frame, as when something moves in front: what is kept and tried does not add up."""

import pickle

import numpy as np
import pytest

from bscd.dic import generations, tracking
from bscd.dic.generations import MOST_KEPT
from bscd.dic.recovery import is_due
from bscd.dic.tracker_state import REFERENCE
from bscd.dic.tracking import Tracker, TrackingSettings
from tests.dic.motions import translation
from tests.dic.test_tracker_state import same
from tests.dic.test_tracking import NOISE, SIZE, frame

POINTS = np.stack(np.meshgrid(np.arange(40.0, 221.0, 6.0), np.arange(30.0, 191.0, 6.0)), axis=-1).reshape(-1, 2)
FRAMES = 24
SHIFT = translation(0.3, -0.2)
SETTINGS = TrackingSettings(noise_grey=NOISE)


def band(number):
    """Rows from the top that are covered; it grows by a row of points a frame."""
    return (slice(0, 20 + 6 * number), slice(0, SIZE[0]))


@pytest.fixture(scope="module")
def images():
    shown = {number: frame(SHIFT, number + 1, covered=band(number)) for number in range(FRAMES)}
    return {REFERENCE: frame(), **shown}


class Followed:
    """The sequence tracked; what was found, the images that were kept, and the recoveries tried in each frame."""

    def __init__(self, images, monkeypatch):
        self.tracker, self.found, self.kept, self.tried = Tracker(images[REFERENCE], POINTS, SETTINGS), [], [], []
        recovered = tracking.recovered

        def counted(*args):
            self.tried[-1] += 1
            return recovered(*args)

        with monkeypatch.context() as patch:
            patch.setattr(tracking, "recovered", counted)
            for number in range(FRAMES):
                self.tried.append(0)
                self.found.append(self.tracker.track(images[number]))
                self.kept.append(len(self.tracker.state().images))


@pytest.fixture(scope="module")
def followed(images):
    with pytest.MonkeyPatch.context() as patch:
        return Followed(images, patch)


def test_the_sequence_loses_points_steadily(followed):
    counts = [np.count_nonzero(found.valid) for found in followed.found]
    assert (np.diff(counts[2:]) < 0).all()
    assert followed.found[-1].renewals > 3 * MOST_KEPT
    assert 0.05 < counts[-1] / len(POINTS) < 0.25


def test_the_number_of_kept_images_is_bounded(followed):
    assert max(followed.kept) <= MOST_KEPT + 1  # the previous one besides


def test_recoveries_do_not_grow_with_the_lost_points(followed):
    early, late = np.split(np.array(followed.tried), 2)
    assert late.mean() <= early.mean() + 0.5
    assert late.mean() < MOST_KEPT / 2


def test_points_that_stay_do_not_depend_on_what_is_kept(images, followed, monkeypatch):
    monkeypatch.setattr(generations, "MOST_KEPT", 1000)
    everything = Followed(images, monkeypatch)
    assert everything.kept[-1] > 3 * MOST_KEPT
    stayed = np.all([found.valid for found in followed.found], axis=0)
    assert stayed.sum() > 50
    for one, other in zip(followed.found, everything.found, strict=True):
        for name in ("position_px", "covariance_px2", "gradient", "zncc"):
            np.testing.assert_array_equal(getattr(one, name)[stayed], getattr(other, name)[stayed])


def test_lost_points_come_back_as_sure_as_from_the_first_reference(images, followed):
    moved = translation(0.8, 0.4)
    clear = frame(moved, FRAMES + 1)
    points = Tracker.resumed(followed.tracker.state(), images, SETTINGS)
    long_lost = ~np.any([found.valid for found in followed.found[-10:]], axis=0)
    assert long_lost.sum() > 200
    assert points.track(clear).valid.mean() > 0.97
    found = points.track(clear)
    assert found.valid.mean() > 0.99
    error = found.position_px - POINTS - moved.displacement_px(POINTS)
    back = long_lost & found.valid
    assert np.abs(error[back]).max() < 0.12
    # by the noise of the two images alone, as in a match that knows of no frame between
    direct = Tracker(images[REFERENCE], POINTS, SETTINGS).track(clear)
    sigma = [np.sqrt(np.median(each.covariance_px2[back, 0, 0])) for each in (found, direct)]
    assert sigma[0] == pytest.approx(sigma[1], rel=0.02)
    inside = np.abs(error[back]) < np.sqrt(np.diagonal(found.covariance_px2[back], axis1=1, axis2=2))
    assert 0.61 < inside.mean() < 0.75


def test_it_goes_on_from_its_pickled_state_bit_by_bit(images, followed):
    state = Tracker(images[REFERENCE], POINTS, SETTINGS).state()
    for number in range(FRAMES):
        state = pickle.loads(pickle.dumps(state))
        points = Tracker.resumed(state, {each: images[each] for each in state.images}, SETTINGS)
        assert same(points.track(images[number]), followed.found[number]), number
        state = points.state()


def test_points_are_looked_for_less_and_less_often():
    assert np.flatnonzero(is_due(np.arange(70))).tolist() == [0, 1, 2, 4, 8, 16, 32, 48, 64]
