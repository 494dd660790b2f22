"""A stage as the rig sees it: limits, time-outs, stopping and the errors of all makers' stages, written once."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress

from drivers.clock import Clock
from drivers.errors import (
    DeviceBusyError,
    DeviceError,
    DeviceFaultError,
    DeviceTimeoutError,
    MoveStoppedError,
    NotConnectedError,
    NotHomedError,
    OutOfLimitsError,
)
from drivers.interfaces import AxisInfo, AxisStatus, Range
from drivers.stages.boundary import told
from drivers.stages.controller import Identity, MotorState, StageController
from drivers.stages.options import StageOptions

POLL_S = 0.03
BRAKE_MARGIN_S = 1.0


class StageAxis:
    """One stage; see `drivers.interfaces.Axis`.

    Parameters
    ----------
    name : str
        Name of the device in the rig.
    options : StageOptions
        Its limits, speed and time-outs.
    controller : StageController
        Talks to the device.
    clock : Clock
        Measures moves and waits between looks at them.
    """

    def __init__(self, name: str, options: StageOptions, controller: StageController, clock: Clock) -> None:
        self.name = name
        self._options = options
        self._controller = controller
        self._clock = clock
        self._limits = Range(*options.limits)
        self._connecting = threading.Lock()
        self._moving = threading.Lock()
        self._stopping = threading.Event()
        self._ordering = threading.Lock()
        self._open = False
        self._unsure = False
        self._target = math.nan
        self._identity = Identity("", "", "")

    def connect(self) -> None:
        """Open the port, find the device and give it its settings; moves nothing.

        Raises `DeviceBusyError` when another program has the port, `NotConnectedError` when nothing answers,
        `UnsupportedError` when the device can not do what its options ask.
        """
        with self._connecting:
            if self._open:
                return
            try:
                with self._told("connecting"):
                    self._identity = self._controller.open()
                    self._require_identity()
                    self._target = self._place(self._controller.state())
            except DeviceTimeoutError as err:
                self._controller.close()
                hint = "check its power, its cable and its port"
                raise NotConnectedError(self.name, "connecting: no answer", hint) from err
            except DeviceError:
                self._controller.close()
                raise
            self._open = True

    def close(self) -> None:
        """Stop the axis, wait until it is at rest, as far as it answers, and give its port free."""
        with self._connecting:
            if not self._open:
                return
            with suppress(DeviceError):
                self.stop()
                self._await_rest("closing")
            self._open = False
            self._controller.close()

    def info(self) -> AxisInfo:
        """Identity and capabilities; asks nothing of the device."""
        self._require_open("asking for its identity")
        return AxisInfo(
            vendor=self._identity.vendor,
            model=self._options.model or self._identity.model,
            serial=self._identity.serial,
            unit=self._options.unit,
            limits=self._limits,
            resolution=1.0 / abs(self._controller.microsteps_per_unit),
            repeatability=self._options.repeatability,
            speed=self._options.speed,
            can_home=True,
            firmware=self._identity.firmware,
        )

    def status(self) -> AxisStatus:
        """State now; "not connected" also when the line is found to be gone."""
        if self._open:
            with suppress(NotConnectedError):
                state = self._state("asking for its status")
                return AxisStatus(
                    connected=True,
                    homed=state.homed and not self._unsure,
                    moving=state.moving,
                    position=self._place(state),
                    target=self._target,
                    fault=state.fault,
                )
        return AxisStatus(connected=False, homed=False, moving=False, position=math.nan, target=math.nan)

    def move_duration_s(self, position: float) -> float:
        """Seconds of a move from the present reading to ``position``: a trapezoid of speed and acceleration."""
        doing = f"computing a move to {position:g} {self._options.unit}"
        self._require_open(doing)
        self._require_inside(position, doing)
        return self._duration_s(self._state(doing), self._count(position))

    def home(self) -> None:
        """Find the reference as the options say, and return when there, homed."""
        doing = "homing"
        self._require_open(doing)
        with self._one_move(doing):
            self._require_rest(self._state(doing), doing)
            self._unsure = True  # until it is done: a search that is broken off leaves the position in doubt
            with self._told(doing):
                self._controller.prepare()
                self._set_off(doing, self._controller.begin_home)
            self._finish(doing, None, self._options.timeout_factor * self._controller.longest_homing_s)
            with self._told(doing):
                self._controller.end_home()
                state = self._controller.state()
            if not state.homed:
                raise DeviceFaultError(self.name, f"{doing}: it ended without the reference", "look at its switches")
            self._unsure = False
            self._target = self._place(state)

    def move_to(self, position: float) -> None:
        """Move to ``position`` and return when there and at rest; see `drivers.interfaces.Axis.move_to`."""
        doing = f"moving to {position:g} {self._options.unit}"
        self._require_open(doing)
        self._require_inside(position, doing)
        goal = self._count(position)
        with self._one_move(doing):
            state = self._state(doing)
            self._require_rest(state, doing)
            if not state.homed or self._unsure:
                raise NotHomedError(self.name, f"{doing}: it does not know where it is", "home it first")
            with self._told(doing):
                if not self._controller.prepare():
                    self._unsure = True
                    raise NotHomedError(self.name, f"{doing}: it was switched off in between", "home it first")
                self._target = position
                self._set_off(doing, lambda: self._controller.begin_move(goal))
            duration_s = self._duration_s(state, goal) + self._controller.longest_approach_s
            self._finish(doing, goal, self._options.timeout_factor * duration_s)

    def stop(self) -> None:
        """Begin to decelerate, at once; does nothing without a connection."""
        if not self._open:
            return
        self._stopping.set()
        with self._ordering, self._told("stopping"):
            self._controller.halt()

    def _count(self, position: float) -> int:
        return round(position * self._controller.microsteps_per_unit)

    def _place(self, state: MotorState) -> float:
        return round(state.count / self._controller.microsteps_per_unit, 9) + 0.0

    def _state(self, doing: str) -> MotorState:
        with self._told(doing):
            return self._controller.state()

    def _duration_s(self, state: MotorState, goal: int) -> float:
        distance = abs((goal - state.count) / self._controller.microsteps_per_unit)
        speed, acceleration = self._options.speed, self._options.acceleration
        if distance < speed**2 / acceleration:
            return 2.0 * math.sqrt(distance / acceleration)
        return distance / speed + speed / acceleration

    def _lose(self) -> None:
        self._open = False
        self._controller.close()

    def _told(self, doing: str) -> AbstractContextManager[None]:
        return told(self.name, doing, self._lose)

    def _require_open(self, doing: str) -> None:
        if not self._open:
            raise NotConnectedError(self.name, f"{doing}: it is not connected", "call connect() first")

    def _require_identity(self) -> None:
        wanted, found = self._options.serial_number, self._identity.serial
        if wanted and wanted != found:
            raise NotConnectedError(self.name, f"connecting: number {found} answers, not {wanted}", "check the ports")

    def _require_inside(self, position: float, doing: str) -> None:
        if not self._limits.contains(position):
            allowed = f"{self._limits.low:g} to {self._limits.high:g} {self._options.unit}"
            raise OutOfLimitsError(self.name, f"{doing}: outside its limits", f"choose a position from {allowed}")

    def _require_rest(self, state: MotorState, doing: str) -> None:
        if state.moving:
            raise DeviceBusyError(self.name, f"{doing}: it still moves", "wait until it is at rest, or stop it")

    @contextmanager
    def _one_move(self, doing: str) -> Iterator[None]:
        if not self._moving.acquire(blocking=False):
            raise DeviceBusyError(self.name, f"{doing}: another move is under way", "wait for its end, or stop it")
        try:
            self._stopping.clear()
            yield
        finally:
            self._moving.release()

    def _set_off(self, doing: str, begin: Callable[[], None]) -> None:
        """Give the order, unless somebody has called `stop` meanwhile; none can come in between."""
        with self._ordering:
            if self._stopping.is_set():
                raise MoveStoppedError(self.name, f"{doing}: stopped before it set off")
            begin()

    def _finish(self, doing: str, goal: int | None, duration_s: float) -> None:
        """Wait until it is at rest, and raise what kept it from its goal."""
        timeout_s = duration_s + self._options.timeout_margin_s
        deadline_s = self._clock.now_s() + timeout_s
        rested = False
        while True:
            state = self._state(doing)
            # one that has not set off yet looks like one that has ended elsewhere: look twice
            if not state.moving and (rested or self._arrived(state, goal)):
                return self._judge(state, doing, goal)
            rested = not state.moving
            if self._clock.now_s() >= deadline_s:
                with self._told(doing):
                    self._controller.halt()
                self._await_rest(doing)
                raise DeviceTimeoutError(
                    self.name, f"{doing}: not there within {timeout_s:.1f} s", "look what blocks it, then home it"
                )
            self._clock.sleep(POLL_S)

    def _await_rest(self, doing: str) -> None:
        """Wait as long as braking may take."""
        deadline_s = self._clock.now_s() + self._options.speed / self._options.acceleration + BRAKE_MARGIN_S
        while self._state(doing).moving and self._clock.now_s() < deadline_s:
            self._clock.sleep(POLL_S)

    def _arrived(self, state: MotorState, goal: int | None) -> bool:
        if state.fault or not state.homed:
            return False
        if goal is None:
            return not (self._stopping.is_set() or state.interrupted or state.failed)
        return abs(state.count - goal) <= abs(self._options.tolerance * self._controller.microsteps_per_unit)

    def _judge(self, state: MotorState, doing: str, goal: int | None) -> None:
        if self._arrived(state, goal):
            return
        where = f"{self._place(state):g} {self._options.unit}"
        if state.fault:
            raise DeviceFaultError(self.name, f"{doing}: {state.fault}", "free the axis, then move or home it again")
        if self._stopping.is_set() or state.interrupted:
            raise MoveStoppedError(self.name, f"{doing}: stopped on the way, reading {where}")
        if not state.homed:
            raise DeviceFaultError(self.name, f"{doing}: it no longer knows where it is", "check its power, home it")
        raise DeviceFaultError(self.name, f"{doing}: it ended at {where}", "look what blocks it, then home it")
