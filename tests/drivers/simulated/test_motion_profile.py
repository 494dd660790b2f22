"""Properties of the motion profile, against the kinematics it must obey."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.simulated.motion import at_rest, braking, duration_s, position_at, trapezoidal, velocity_at

positions = st.floats(-360.0, 360.0).map(lambda value: round(value, 4))
speeds = st.floats(0.05, 50.0)
accelerations = st.floats(0.05, 500.0)


def sampled(motion, count=400):
    times_s = np.linspace(0.0, duration_s(motion), count)
    return times_s, np.array([position_at(motion, time_s) for time_s in times_s])


@given(positions, positions, speeds, accelerations)
@settings(max_examples=150, deadline=None)
def test_obeys_its_limits_and_arrives_exactly(start, end, speed, acceleration):
    motion = trapezoidal(start, end, speed, acceleration)
    total_s = duration_s(motion)
    assert position_at(motion, 0.0) == start
    assert position_at(motion, -1.0) == start
    assert position_at(motion, total_s) == end
    assert position_at(motion, total_s + 1.0) == end
    if start == end:
        assert total_s == 0.0
        return
    times_s, path = sampled(motion)
    step_s = times_s[1]
    rounding = 1e-12 * (abs(start) + abs(end) + 1.0)
    velocity = np.diff(path) / step_s
    assert np.max(np.abs(velocity)) <= speed * (1 + 1e-9) + rounding / step_s
    assert np.max(np.abs(np.diff(velocity))) / step_s <= acceleration * (1 + 1e-6) + 4 * rounding / step_s**2
    assert np.all(np.diff(path) * math.copysign(1.0, end - start) >= -rounding)
    just_before = position_at(motion, math.nextafter(total_s, 0.0))
    assert just_before == pytest.approx(end, abs=1e-9 * (abs(end - start) + 1.0))


@given(positions, positions, speeds, accelerations, st.floats(0.0, 1.0))
@settings(max_examples=150, deadline=None)
def test_velocity_is_the_slope_of_position(start, end, speed, acceleration, share):
    motion = trapezoidal(start, end, speed, acceleration)
    total_s = duration_s(motion)
    step_s = 1e-4 * total_s
    time_s = step_s + share * (total_s - 3.0 * step_s)
    if start == end:
        assert velocity_at(motion, time_s) == 0.0
        return
    slope = (position_at(motion, time_s + step_s) - position_at(motion, time_s - step_s)) / (2.0 * step_s)
    rounding = 1e-12 * (abs(start) + abs(end) + 1.0) / step_s
    assert velocity_at(motion, time_s) == pytest.approx(slope, abs=acceleration * step_s + rounding)


@given(positions, positions, speeds, accelerations, st.floats(0.0, 1.2))
@settings(max_examples=150, deadline=None)
def test_stops_on_the_way(start, end, speed, acceleration, share):
    motion = trapezoidal(start, end, speed, acceleration)
    time_s = share * duration_s(motion)
    stop = braking(motion, time_s, acceleration)
    rounding = 1e-9 * (abs(start) + abs(end) + 1.0)
    here, rest = position_at(motion, time_s), position_at(stop, duration_s(stop))
    assert position_at(stop, 0.0) == here
    assert velocity_at(stop, duration_s(stop)) == 0.0
    assert min(here, end) - rounding <= rest <= max(here, end) + rounding
    assert abs(rest - here) == pytest.approx(velocity_at(motion, time_s) ** 2 / (2.0 * acceleration), abs=rounding)
    assert duration_s(stop) * acceleration == pytest.approx(abs(velocity_at(motion, time_s)))


@pytest.mark.parametrize(
    ("name", "start", "end", "seconds", "middle"),
    [
        # 100 at 10 unit/s and 5 unit/s^2: 2 s ramps of 10 units each and 80 units at 10 unit/s
        ("trapezium", 0.0, 100.0, 12.0, 50.0),
        # 5 units never reach 10 unit/s: 1 s up, 1 s down
        ("triangle", 0.0, 5.0, 2.0, 2.5),
        # 20 units: the two ramps touch
        ("touching", 0.0, 20.0, 4.0, 10.0),
        ("backwards", 40.0, -60.0, 12.0, -10.0),
        ("nowhere", 3.0, 3.0, 0.0, 3.0),
    ],
)
def test_takes_the_time_that_kinematics_say(name, start, end, seconds, middle):
    motion = trapezoidal(start, end, speed=10.0, acceleration=5.0)
    assert duration_s(motion) == pytest.approx(seconds, abs=1e-12)
    assert position_at(motion, seconds / 2.0) == pytest.approx(middle, abs=1e-12)


def test_rests():
    assert duration_s(at_rest(4.2)) == 0.0
    assert position_at(at_rest(4.2), 1.0) == 4.2
    assert braking(at_rest(4.2), 1.0, 5.0) == at_rest(4.2)
