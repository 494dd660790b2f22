"""The ring of readings: each later one once, and every missing one counted."""

from itertools import cycle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.interfaces import PressureReading
from drivers.pressure.readings import ReadingRing

PERIOD_NS = 10_000_000


def filled(places, capacity=1000):
    ring = ReadingRing(capacity)
    for place in places:
        ring.add(place, PressureReading(float(place), 5 * PERIOD_NS + place * PERIOD_NS))
    return ring


def time_ns(place):
    return 5 * PERIOD_NS + place * PERIOD_NS


def told(fetched):
    return [round(reading.pressure_kpa) for reading in fetched.readings], fetched.lost


@pytest.mark.parametrize(
    ("places", "capacity", "since_ns", "expected"),
    [
        ([], 10, 0, ([], 0)),
        ([0, 1, 2], 10, 0, ([0, 1, 2], 0)),
        ([0, 1, 2], 10, time_ns(0), ([1, 2], 0)),
        ([0, 1, 2], 10, time_ns(2), ([], 0)),
        ([2, 3], 10, 0, ([2, 3], 2)),
        ([0, 1, 5], 10, time_ns(1), ([5], 3)),
        ([0, 1, 5], 10, time_ns(1) + 1, ([5], 3)),
        (range(20), 5, time_ns(14), (list(range(15, 20)), 0)),
        (range(20), 5, time_ns(11), (list(range(15, 20)), 3)),
        (range(20), 5, time_ns(17), ([18, 19], 0)),
        (range(20), 5, 0, (list(range(15, 20)), 15)),
    ],
)
def test_tells_what_is_later_and_what_is_missing(places, capacity, since_ns, expected):
    assert told(filled(places, capacity).since(since_ns)) == expected


@given(
    st.lists(st.integers(1, 4), min_size=1, max_size=60), st.integers(1, 80), st.lists(st.integers(1, 7), min_size=1)
)
def test_whoever_asks_in_time_gets_all_and_counts_the_rest(jumps, capacity, strides):
    """Asked with the last one's time, what comes and what is lost add up to the last place."""
    ring = ReadingRing(capacity)
    place, last_ns, received, lost, stride = -1, 0, 0, 0, cycle(strides)
    until_asked = next(stride)
    for jump in jumps:
        place += jump
        ring.add(place, PressureReading(0.0, time_ns(place)))
        until_asked -= 1
        if until_asked == 0:
            until_asked = next(stride)
            fetched = ring.since(last_ns)
            received, lost = received + len(fetched.readings), lost + fetched.lost
            last_ns = fetched.readings[-1].host_time_ns
            assert received + lost == place + 1


def test_forgets_on_command():
    ring = filled(range(20), 5)
    ring.clear()
    assert told(ring.since(0)) == ([], 0)
    ring.add(0, PressureReading(0.0, time_ns(0)))
    assert told(ring.since(0)) == ([0], 0)
