"""The two lab jacks on Modbus drives as one axis: the sum of both heights."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

from drivers.errors import (
    DeviceBusyError,
    DeviceError,
    DeviceFaultError,
    MoveStoppedError,
    NotConnectedError,
    NotHomedError,
    OutOfLimitsError,
)
from drivers.interfaces import AxisInfo, AxisStatus
from drivers.jacks.modbus.drive import Drive, DriveState
from drivers.jacks.modbus.options import ModbusJacksOptions
from drivers.jacks.modbus.register_map import load_register_map
from drivers.jacks.modbus.waiting import Arrival, Waiting
from drivers.jacks.travel import travel_s
from drivers.modbus import Line
from drivers.registry import DriverContext
from drivers.stacked import split_height

Command = Callable[[str], None]
FREE_IT = "free the jack, then move or home it again"


class ModbusJacks:
    """See `drivers.interfaces.Axis`; ``docs/drivers/modbus-jacks.md`` says how to wire and set up the drives."""

    def __init__(self, options: ModbusJacksOptions, context: DriverContext) -> None:
        self.name = context.name
        self._options = options
        self._clock = context.clock
        self._registers = load_register_map(options.register_map)
        self._line = Line(context.name, options.address, options.serial, options.answer_timeout_s, context.clock)
        self._drives = tuple(
            Drive(label, self._line, jack.unit, self._registers)
            for label, jack in zip(("lower jack", "upper jack"), options.jacks, strict=True)
        )
        self._waiting = Waiting(self.name, context.clock, self._drives)
        self._connecting = threading.Lock()
        self._one_at_a_time = threading.Lock()
        self._commanding = threading.Lock()
        self._stopped = threading.Event()
        self._target: float | None = None

    def connect(self) -> None:
        """Open the line and hear both drives; moves nothing.

        Raises `NotConnectedError`, naming all that are silent, or `DeviceBusyError`.
        """
        with self._connecting:
            if self._line.is_open:
                return
            self._line.open()
            silent: list[DeviceError] = []
            for drive in self._drives:
                try:
                    drive.state("connecting")
                except DeviceError as error:
                    silent.append(error)
            if silent:
                self._line.close()
                if isinstance(silent[0], DeviceBusyError):
                    raise silent[0]
                reasons = "; ".join(error.doing for error in silent)
                raise NotConnectedError(self.name, reasons, silent[0].hint) from silent[0]
            self._target = None

    def close(self) -> None:
        """Stop the jacks, as far as they answer, and close the line; waits until a move has come to its end."""
        with suppress(DeviceError):
            self.stop()
        if self._one_at_a_time.acquire(timeout=self._braking_s() + self._options.timeout_margin_s):
            self._one_at_a_time.release()
        self._line.close()

    def info(self) -> AxisInfo:
        """Identity and capabilities, as configured: the drives do not tell theirs."""
        self._line.require_open("asking for its identity")
        options = self._options
        return AxisInfo(
            vendor=self._registers.vendor,
            model=f"{self._registers.model}, two jacks",
            serial=f"{options.address} units {options.lower.unit}+{options.upper.unit}",
            unit="mm",
            limits=options.limits_mm,
            resolution=max(1.0 / jack.steps_per_mm for jack in options.jacks),
            repeatability=math.sqrt(2.0) * options.repeatability_mm,
            speed=options.speed_mm_s,
            can_home=True,
        )

    def status(self) -> AxisStatus:
        """State now; without a connection, also a lost one, the position is not known (NaN)."""
        nowhere = AxisStatus(connected=False, homed=False, moving=False, position=math.nan, target=math.nan)
        if not self._line.is_open:
            return nowhere
        try:
            states = self._states("asking for its status")
        except NotConnectedError:
            return nowhere
        position = self._height_mm(states)
        return AxisStatus(
            connected=True,
            homed=all(state.homed for state in states),
            moving=any(state.moving for state in states),
            position=position,
            target=position if self._target is None else self._target,
            fault=self._alarms(states),
        )

    def move_duration_s(self, position: float) -> float:
        """Seconds of a move from the present reading to ``position``."""
        doing = f"computing a move to {position:g} mm"
        self._line.require_open(doing)
        targets = self._split(position, doing)
        return self._duration_s(self._states(doing), targets)

    def home(self) -> None:
        """Let both drives find their reference and return when there, homed."""
        doing = "homing"
        self._line.require_open(doing)
        with self._one_move(doing):
            longest_s = max(
                (jack.limits_mm[1] - jack.limits_mm[0]) / self._options.homing_speed_mm_s
                for jack in self._options.jacks
            )
            self._target = None
            self._set_off(doing, [drive.begin_home for drive in self._drives])
            self._finish(doing, [None, None], longest_s)

    def move_to(self, position: float) -> None:
        """Move to ``position`` and return when there and at rest."""
        doing = f"moving to {position:g} mm"
        self._line.require_open(doing)
        targets = self._split(position, doing)
        with self._one_move(doing) as states:
            if not all(state.homed for state in states):
                raise NotHomedError(self.name, f"{doing}: it does not know where it is", "home it first")
            duration_s = self._duration_s(states, targets)
            self._target = position
            self._set_off(doing, [self._beginning(*each) for each in zip(self._drives, targets, (0, 1), strict=True)])
            self._finish(doing, targets, duration_s)

    def stop(self) -> None:
        """Begin to decelerate, at once; does nothing at rest or without a connection."""
        if not self._line.is_open:
            return
        with self._commanding:
            self._stopped.set()
            self._halt("stopping")
            if not self._one_at_a_time.locked():  # else the call that moves releases them at rest
                self._release("stopping")

    @contextmanager
    def _one_move(self, doing: str) -> Iterator[list[DriveState]]:
        """The states before a move, with both drives at rest and taking commands."""
        with self._commanding:  # a stop comes before all of this or counts
            if not self._one_at_a_time.acquire(blocking=False):
                raise DeviceBusyError(self.name, f"{doing}: another move is under way", "wait for its end, or stop it")
            self._stopped.clear()
        try:
            states = self._states(doing)
            if any(state.moving for state in states):
                raise DeviceBusyError(self.name, f"{doing}: it moves already", "wait until it is at rest, or stop it")
            yield states
        finally:
            self._one_at_a_time.release()

    def _set_off(self, doing: str, commands: Sequence[Command]) -> None:
        """Clear what keeps the drives from moving and command both; when one fails, neither moves."""
        self._release(doing)
        self._reset_alarms(doing)
        with self._commanding:
            if self._stopped.is_set():
                raise MoveStoppedError(self.name, f"{doing}: stopped before it began")
            try:
                for command in commands:
                    command(doing)
            except DeviceError:
                self._give_up(doing)
                raise

    def _beginning(self, drive: Drive, steps: int, index: int) -> Command:
        jack = self._options.jacks[index]
        speed = round(self._options.speed_mm_s * jack.steps_per_mm)
        acceleration = round(self._options.acceleration_mm_s2 * jack.steps_per_mm)
        return lambda doing: drive.begin_move(steps, max(1, speed), max(1, acceleration), doing)

    def _finish(self, doing: str, targets: Sequence[int | None], duration_s: float) -> None:
        """Wait until both jacks are at rest, and raise what kept one from its target."""
        timeout_s = self._options.timeout_factor * duration_s + self._options.timeout_margin_s
        near = [max(1, round(self._options.in_position_mm * jack.steps_per_mm)) for jack in self._options.jacks]
        try:
            states = self._waiting.until_rest(doing, targets, near, timeout_s, self._stopped.is_set)
        except DeviceError:
            self._give_up(doing)
            raise
        self._release(doing)
        if alarms := self._alarms([state for _, state in states]):
            raise DeviceFaultError(self.name, f"{doing}: {alarms}", FREE_IT)
        if all(arrival is Arrival.THERE for arrival, _ in states):
            return
        if not all(state.homed for _, state in states) and targets[0] is not None:
            raise NotHomedError(self.name, f"{doing}: it lost its reference on the way", "home it")
        if any(arrival is Arrival.NEVER_SET_OFF for arrival, _ in states) and not self._stopped.is_set():
            raise DeviceFaultError(self.name, f"{doing}: a jack did not set off", "look at its drive's own display")
        where = f"{self._height_mm([state for _, state in states]):g} mm"
        raise MoveStoppedError(self.name, f"{doing}: stopped on the way, reading {where}")

    def _give_up(self, doing: str) -> None:
        """Stop both jacks, as far as they answer."""
        with suppress(DeviceError):
            self._halt(doing)

    def _halt(self, doing: str) -> None:
        self._each([drive.stop for drive in self._drives], doing)

    def _release(self, doing: str) -> None:
        self._each([drive.release for drive in self._drives], doing)

    def _each(self, commands: Sequence[Command], doing: str) -> None:
        """Command both drives, the second also when the first fails."""
        failed: list[DeviceError] = []
        for command in commands:
            try:
                command(doing)
            except DeviceError as error:
                failed.append(error)
        if failed:
            raise failed[0]

    def _reset_alarms(self, doing: str) -> None:
        for drive in self._drives:
            if drive.state(doing).alarm:
                drive.reset_alarm(doing)
                if alarm := drive.state(doing).alarm:
                    raise DeviceFaultError(self.name, f"{doing}: {drive.label}: {alarm}", FREE_IT)

    def _split(self, position: float, doing: str) -> list[int]:
        """Steps of the lower and the upper jack. Raises `OutOfLimitsError`; sends nothing."""
        options, limits = self._options, self._options.limits_mm
        allowed = f"choose a height from {limits.low:g} to {limits.high:g} mm"
        if not limits.contains(position):
            raise OutOfLimitsError(self.name, f"{doing}: outside its limits", allowed)
        lower, upper = options.jacks
        ranges = lower.range_mm, upper.range_mm
        part, _ = split_height(position, ranges, options.lower_share, 1.0 / lower.steps_per_mm)
        lower_steps = lower.steps(part)
        steps = [lower_steps, upper.steps(position - lower.height_mm(lower_steps))]
        for drive, jack, step in zip(self._drives, options.jacks, steps, strict=True):
            if not jack.range_mm.contains(round(jack.height_mm(step), 9)):
                raise OutOfLimitsError(self.name, f"{doing}: the {drive.label} would leave its limits", allowed)
        return steps

    def _states(self, doing: str) -> list[DriveState]:
        return [drive.state(doing) for drive in self._drives]

    def _height_mm(self, states: Sequence[DriveState]) -> float:
        pairs = zip(self._options.jacks, states, strict=True)
        return round(sum(jack.height_mm(state.position) for jack, state in pairs), 9)

    def _alarms(self, states: Sequence[DriveState]) -> str:
        pairs = zip(self._drives, states, strict=True)
        return "; ".join(f"{drive.label}: {state.alarm}" for drive, state in pairs if state.alarm)

    def _braking_s(self) -> float:
        return self._options.speed_mm_s / self._options.acceleration_mm_s2

    def _duration_s(self, states: Sequence[DriveState], targets: Sequence[int]) -> float:
        options = self._options
        return max(
            travel_s((target - state.position) / jack.steps_per_mm, options.speed_mm_s, options.acceleration_mm_s2)
            for jack, state, target in zip(options.jacks, states, targets, strict=True)
        )
