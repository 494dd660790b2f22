"""Frames made ahead: fresh noise each, the present state always, errors where they belong."""

import threading

import numpy as np
import pytest

from drivers.emulators.gige.exposures import Exposures
from tests.drivers.emulators.gige.test_formats import readout


class Sensor:
    """Pixel 0 shows the state, pixel 1 how many exposures were made."""

    def __init__(self):
        self.state = 7
        self.made = 0
        self.ahead = threading.Event()
        self.error = None
        self.go_on = threading.Event()
        self.go_on.set()

    def expose(self, exposure_s, gain_db):
        if self.error is not None:
            raise self.error
        assert self.go_on.wait(10)
        image = np.zeros((4, 6), np.uint8)
        self.made += 1
        image[0, :2] = self.state, self.made
        if self.made >= 5:
            self.ahead.set()
        return image


@pytest.fixture
def sensor():
    return Sensor()


@pytest.fixture
def exposures(sensor):
    exposures = Exposures(sensor.expose, lambda: sensor.state, 8)
    yield exposures
    exposures.close()


def test_each_frame_has_noise_of_its_own(sensor, exposures):
    first = exposures.take(readout())
    assert sensor.ahead.wait(10)
    later = [exposures.take(readout()) for _ in range(4)]
    assert len({first, *later}) == 5


def test_a_frame_shows_the_state_now_however_many_were_made_ahead(sensor, exposures):
    exposures.take(readout())
    assert sensor.ahead.wait(10)
    for state in (8, 9, 8):
        sensor.state = state
        assert exposures.take(readout())[0] == state
    assert exposures.take(readout(gain_db=3.0))[0] == 8


def test_at_a_rate_it_can_not_follow_frames_come_again(sensor, exposures):
    first = exposures.take(readout())
    assert sensor.ahead.wait(10)
    sensor.go_on.clear()  # from here on no frame is made
    frames = [exposures.take(readout()) for _ in range(20)]
    sensor.go_on.set()
    assert set(frames[4:]) <= {first, *frames[:4]}
    assert all(frame[0] == 7 for frame in frames)


def test_an_exposure_that_fails_raises_where_its_frame_is_wanted(sensor, exposures):
    sensor.error = RuntimeError("no light")
    with pytest.raises(RuntimeError, match="no light"):
        exposures.take(readout())
    sensor.error = None
    assert exposures.take(readout())[0] == 7


def test_it_ends_its_thread(sensor):
    exposures = Exposures(sensor.expose, lambda: sensor.state, 8)
    exposures.take(readout())
    exposures.close()
    exposures.close()
    assert "gige-exposures" not in [thread.name for thread in threading.enumerate()]
