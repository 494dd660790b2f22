"""What emulators ask of a motor beyond the axis: moves by the bare counter, and switching off and on."""

import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceBusyError
from drivers.registry import DriverContext
from drivers.simulated import SimulatedAxis, TranslationOptions
from drivers.simulated.carriage import LIMIT_SWITCH_HIT, Activity, Carriage, Ending


def build(clock, world, **options) -> Carriage:
    options = {"start_mm": 40.0, "repeatability_mm": 0.0, "resolution_mm": 0.01, **options}
    axis = SimulatedAxis(TranslationOptions(**options), DriverContext("translation", clock, world))
    return axis.carriages[0]


def test_moves_by_its_counter_before_it_is_homed(clock: VirtualClock, world):
    motor = build(clock, world)
    motor.drive_to(10.0, 5.0)
    with pytest.raises(DeviceBusyError):
        motor.drive_to(0.0, 5.0)
    clock.sleep(10.0)
    assert (motor.state().reading, motor.true_position()) == (10.0, 50.0)
    assert (motor.state().homed, motor.state().alarm) == (False, "")


@pytest.mark.parametrize(("wanted", "end"), [(70.0, 100.0), (-50.0, 0.0)])
def test_a_limit_switch_ends_what_would_leave_the_travel(clock, world, wanted, end):
    motor = build(clock, world)
    motor.drive_to(wanted, 5.0)
    clock.sleep(30.0)
    state = motor.state()
    assert motor.true_position() == end
    assert (state.ending, state.alarm) == (Ending.FAULT, LIMIT_SWITCH_HIT)
    motor.drive_to(0.0, 5.0)
    clock.sleep(30.0)
    assert (motor.true_position(), motor.state().ending, motor.state().alarm) == (40.0, Ending.COMPLETED, "")


def test_goes_as_fast_as_it_is_told_and_can(clock, world):
    motor = build(clock, world, speed_mm_s=5.0, acceleration_mm_s2=20.0)
    motor.drive_to(10.0, 2.0)
    assert motor.state().remaining_s == pytest.approx(10.0 / 2.0 + 2.0 / 20.0)
    motor.halt()
    clock.sleep(1.0)
    motor.drive_to(10.0, 50.0)
    assert motor.state().remaining_s == pytest.approx(10.0 / 5.0 + 5.0 / 20.0, abs=0.01)


def test_forgets_where_it_is_when_switched_off(clock, world):
    motor = build(clock, world, homed_at_start=False)
    motor.begin_home()
    clock.sleep(30.0)
    motor.begin_move(30.0)
    clock.sleep(3.0)
    here = motor.true_position()
    motor.power_cycle()
    clock.sleep(30.0)
    state = motor.state()
    assert 0.0 < here < 30.0
    assert motor.true_position() == here
    assert (state.homed, state.reading, state.activity) == (False, 0.0, Activity.RESTING)


def test_an_absolute_one_does_not_forget(clock, world):
    motor = build(clock, world, homed_at_start=True)
    motor.begin_move(30.0)
    clock.sleep(30.0)
    motor.power_cycle()
    assert (motor.state().homed, motor.state().reading) == (True, 30.0)
