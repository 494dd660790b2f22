"""What the axis makes of a controller that does odd things, in virtual time."""

import threading
from collections.abc import Callable
from dataclasses import replace

import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceFaultError, DeviceTimeoutError, MoveStoppedError, NotHomedError
from drivers.stages.axis import StageAxis
from drivers.stages.controller import Identity, MotorState
from drivers.stages.options import StageOptions

OPTIONS = StageOptions(
    port="/dev/none", unit="mm", limits=(-10.0, 10.0), speed=1.0, acceleration=1.0, timeout_margin_s=2.0
)
AT_REST = MotorState(count=0, moving=False, homed=True, fault="", interrupted=False)


class Scripted:
    """A controller whose motion is a list of states, one for each look; the last one stays."""

    microsteps_per_unit = 100.0
    longest_homing_s = 5.0
    longest_approach_s = 0.0

    def __init__(self, *motion: MotorState, before: Callable[[], None] = lambda: None) -> None:
        self.orders: list[str] = []
        self._motion = list(motion)
        self._states = [AT_REST]
        self._before = before

    def open(self) -> Identity:
        return Identity("Nobody", "nothing", "0")

    def close(self) -> None: ...

    def state(self) -> MotorState:
        return self._states.pop(0) if len(self._states) > 1 else self._states[0]

    def prepare(self) -> bool:
        self._before()
        return True

    def begin_move(self, count: int) -> None:
        self.orders.append(f"move {count}")
        self._states = self._motion

    def begin_home(self) -> None:
        self.orders.append("home")
        self._states = self._motion

    def end_home(self) -> None:
        self.orders.append("end home")

    def halt(self) -> None:
        self.orders.append("halt")


@pytest.fixture
def clock():
    return VirtualClock()


def build(controller: Scripted, clock: VirtualClock) -> StageAxis:
    axis = StageAxis("stage", OPTIONS, controller, clock)
    axis.connect()
    return axis


MOVING = replace(AT_REST, moving=True)
THERE = replace(AT_REST, count=100)


def test_a_stop_before_it_sets_off_keeps_it_there(clock):
    def stop_elsewhere() -> None:
        thread = threading.Thread(target=axis.stop)
        thread.start()
        thread.join(5.0)

    controller = Scripted(MOVING, THERE, before=stop_elsewhere)
    axis = build(controller, clock)
    with pytest.raises(MoveStoppedError, match="before it set off"):
        axis.move_to(1.0)
    assert controller.orders == ["halt"]


def test_a_stop_of_long_ago_does_not_count(clock):
    controller = Scripted(MOVING, THERE)
    axis = build(controller, clock)
    axis.stop()
    axis.move_to(1.0)
    assert controller.orders == ["halt", "move 100"]


def test_one_that_sets_off_late_is_waited_for(clock):
    axis = build(Scripted(AT_REST, MOVING, MOVING, THERE), clock)
    axis.move_to(1.0)
    assert axis.status().position == 1.0


def test_one_that_does_not_set_off(clock):
    axis = build(Scripted(AT_REST), clock)
    with pytest.raises(DeviceFaultError, match="it ended at 0 mm"):
        axis.move_to(1.0)


@pytest.mark.parametrize(
    ("end", "error", "words"),
    [
        (replace(THERE, count=99), DeviceFaultError, "it ended at 0.99 mm"),
        (replace(THERE, count=50, interrupted=True), MoveStoppedError, "reading 0.5 mm"),
        (replace(THERE, homed=False), DeviceFaultError, "no longer knows where it is"),
        (replace(THERE, fault="it burns"), DeviceFaultError, "it burns"),
        (replace(THERE, count=50, interrupted=True, fault="it burns"), DeviceFaultError, "it burns"),
    ],
)
def test_how_a_move_may_end(clock, end, error, words):
    axis = build(Scripted(MOVING, end), clock)
    with pytest.raises(error, match=words):
        axis.move_to(1.0)


@pytest.mark.parametrize(
    ("end", "error", "words"),
    [
        (replace(AT_REST, homed=False), DeviceFaultError, "no longer knows where it is"),
        (replace(AT_REST, failed=True), DeviceFaultError, "it ended at 0 mm"),
        (replace(AT_REST, interrupted=True), MoveStoppedError, "stopped on the way"),
        (replace(AT_REST, fault="it burns"), DeviceFaultError, "it burns"),
    ],
)
def test_a_homing_that_is_broken_off_leaves_it_not_homed(clock, end, error, words):
    controller = Scripted(MOVING, end)
    axis = build(controller, clock)
    with pytest.raises(error, match=words):
        axis.home()
    assert "end home" not in controller.orders
    assert not axis.status().homed
    with pytest.raises(NotHomedError):
        axis.move_to(1.0)


def test_times_out_from_distance_and_speed(clock):
    controller = Scripted(MOVING)
    axis = build(controller, clock)
    began_s = clock.now_s()
    with pytest.raises(DeviceTimeoutError, match=r"not there within 11\.0 s"):
        axis.move_to(5.0)
    # 5 mm at 1 mm/s and a ramp of 1 s, times 1.5, and the margin of 2 s; then a second of braking and one of grace
    assert clock.now_s() - began_s == pytest.approx(11.0 + 2.0, abs=0.1)
    assert controller.orders == ["move 500", "halt"]


def test_a_tolerance_is_for_encoders(clock):
    options = OPTIONS.model_copy(update={"tolerance": 0.01})
    axis = StageAxis("stage", options, Scripted(MOVING, replace(THERE, count=99)), clock)
    axis.connect()
    axis.move_to(1.0)
    assert axis.status().position == 0.99
    assert axis.status().target == 1.0
