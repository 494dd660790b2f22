"""Neither jack ever leaves its own limits, on no way of any move or homing: judged by where the jacks truly are."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from tests.drivers.jacks.rigs import FAST_MM_S, JackRig, jack_rig, recovers

LOWER = {"unit": 1, "limits_mm": [6.0, 30.0], "height_at_zero_mm": 8.0}
UPPER = {"unit": 2, "limits_mm": [1.0, 19.0], "height_at_zero_mm": 3.0}
LIMITS_MM = np.array([[6.0, 1.0], [30.0, 19.0]])
"""Within the emulated jacks' travel of 0 to 42 mm, at both ends."""
LOWEST_MM, HIGHEST_MM, HOME_MM = 7.0, 49.0, 11.0


@contextmanager
def inner_rig(lower_share: float) -> Iterator[JackRig]:
    """Jacks whose homes lie above the ends of their travel."""
    with jack_rig("tcp", start_mm=30.0, speed_mm_s=FAST_MM_S, lower=LOWER, upper=UPPER, lower_share=lower_share) as rig:
        for carriage, jack in zip(rig.simulated.carriages, (LOWER, UPPER), strict=True):
            carriage.spec = replace(carriage.spec, home=jack["height_at_zero_mm"])
        yield rig


@contextmanager
def watching(rig: JackRig) -> Iterator[list[list[float]]]:
    """The true heights of the lower and the upper jack, every millisecond or so until the end."""
    heights, ended = [], threading.Event()

    def look() -> None:
        while not ended.wait(0.001):
            heights.append([carriage.true_position() for carriage in rig.simulated.carriages])

    watcher = threading.Thread(target=look)
    watcher.start()
    try:
        yield heights
    finally:
        ended.set()
        watcher.join()


@pytest.mark.parametrize("lower_share", [0.0, 0.5, 1.0])
def test_neither_jack_leaves_its_own_limits(lower_share):
    rng = np.random.default_rng(20130521)
    places_mm = [LOWEST_MM, HIGHEST_MM, *rng.uniform(LOWEST_MM, HIGHEST_MM, 5).round(2), HIGHEST_MM]
    with inner_rig(lower_share) as rig, watching(rig) as heights:
        jacks = rig.driver
        recovers(jacks.connect)
        jacks.home()
        for place_mm in places_mm:
            jacks.move_to(place_mm)
            assert rig.truth_mm() == pytest.approx(place_mm, abs=0.011)
            assert jacks.status().position == pytest.approx(rig.truth_mm(), abs=1e-6)
        jacks.home()
        assert rig.truth_mm() == pytest.approx(HOME_MM, abs=1e-6)
        assert jacks.status().position == pytest.approx(HOME_MM, abs=1e-6)
    seen = np.array(heights)
    assert len(seen) > 300
    assert (seen >= LIMITS_MM[0] - 1e-6).all()
    assert (seen <= LIMITS_MM[1] + 1e-6).all()
    # it has been to all four ends
    assert np.abs(seen.min(axis=0) - LIMITS_MM[0]).max() < 0.011
    assert np.abs(seen.max(axis=0) - LIMITS_MM[1]).max() < 0.011


@pytest.mark.parametrize("lower_share", [0.0, 0.5, 1.0])
def test_the_rest_goes_to_the_jack_that_has_room(lower_share):
    """Of 20 mm above both lowest heights, the upper jack can take 18 and the lower one 24."""
    expected_mm = {0.0: [8.0, 19.0], 0.5: [16.0, 11.0], 1.0: [26.0, 1.0]}[lower_share]
    with inner_rig(lower_share) as rig:
        rig.ready().move_to(27.0)
        assert [carriage.true_position() for carriage in rig.simulated.carriages] == pytest.approx(expected_mm)
