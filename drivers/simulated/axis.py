"""The rig's three axes on the twin: rotation stage, translation stage, and the two lab jacks as one axis."""

from __future__ import annotations

import math
import threading
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

import numpy as np

from drivers.errors import (
    DeviceBusyError,
    DeviceError,
    DeviceFaultError,
    DeviceTimeoutError,
    MoveStoppedError,
    NotHomedError,
    OutOfLimitsError,
)
from drivers.interfaces import AxisInfo, AxisStatus, Range
from drivers.registry import DriverContext
from drivers.simulated.carriage import Activity, Carriage, CarriageState, Ending
from drivers.simulated.faults import Fault, Faults
from drivers.simulated.link import Link
from drivers.simulated.options import AnyAxisOptions
from drivers.simulated.world import Quantity, world_of

POLL_S = 0.02

_UNITS = {"rotation": "deg", "translation": "mm", "jack": "mm"}
_QUANTITIES: dict[str, Quantity] = {"rotation": "rotation_deg", "translation": "translation_mm", "jack": "jack_mm"}
_FAULTS = (Fault.NO_ANSWER, Fault.STALLED_MOVE, Fault.HANGING_MOVE, Fault.LIMIT_HIT)


class SimulatedAxis:
    """An axis of one motor, or of two whose positions add up; see `drivers.interfaces.Axis`.

    Attributes
    ----------
    faults : Faults
        Where faults are injected.
    carriages : tuple of Carriage
        The motors with their controllers, for emulators.
    """

    def __init__(self, options: AnyAxisOptions, context: DriverContext) -> None:
        self.name = context.name
        self.faults = Faults(context.name, _FAULTS)
        self._options = options
        self._clock = context.clock
        self._link = Link(context.name, context.clock, self.faults, options.answer_timeout_s)
        self._moving = threading.Lock()
        rng = np.random.default_rng([options.seed, zlib.crc32(context.name.encode())])
        self.carriages = tuple(
            Carriage(context.name, spec, context.clock, self.faults, rng) for spec in options.carriages()
        )
        self._info = _axis_info(options, context.name)
        self._target = _position(self._states())
        world_of(context).bind(_QUANTITIES[options.quantity], self.true_position)

    def connect(self) -> None:
        """Open the connection; moves nothing."""
        self._link.open()

    def close(self) -> None:
        """Stop the axis, as far as it answers, and close the connection."""
        with suppress(DeviceError):
            self.stop()
        self._link.close()

    def info(self) -> AxisInfo:
        """Identity and capabilities."""
        self._link.ask("asking for its identity")
        return self._info

    def status(self) -> AxisStatus:
        """State now; without a connection the position is not known (NaN)."""
        if not self._link.is_open:
            return AxisStatus(connected=False, homed=False, moving=False, position=math.nan, target=math.nan)
        self._link.ask("asking for its status")
        states = self._states()
        return AxisStatus(
            connected=True,
            homed=all(state.homed for state in states),
            moving=_under_way(states),
            position=_position(states),
            target=self._target,
            fault=_alarm(states),
        )

    def move_duration_s(self, position: float) -> float:
        """Seconds of a move from the present reading to ``position``; exact for an axis at rest."""
        doing = f"computing a move to {position:g} {self._info.unit}"
        self._link.require_open(doing)
        self._require_inside(position, doing)
        return self._duration_s(position)

    def home(self) -> None:
        """Go to the reference switches and return when there, homed."""
        doing = "homing"
        self._link.require_open(doing)
        with self._one_move(doing):
            self._link.ask(doing)
            timeout_s = self._timeout_s(max(carriage.longest_homing_s() for carriage in self.carriages))
            for carriage in self.carriages:
                carriage.begin_home()
            self._finish(doing, timeout_s)
            self._target = _position(self._states())

    def move_to(self, position: float) -> None:
        """Move to ``position`` and return when there and at rest."""
        doing = f"moving to {position:g} {self._info.unit}"
        self._link.require_open(doing)
        self._require_inside(position, doing)
        with self._one_move(doing):
            if not all(state.homed for state in self._states()):
                raise NotHomedError(self.name, f"{doing}: it does not know where it is", "home it first")
            self._link.ask(doing)
            timeout_s = self._timeout_s(self._duration_s(position))
            self._target = position
            for carriage, part in zip(self.carriages, self._options.split(position), strict=True):
                carriage.begin_move(part)
            self._finish(doing, timeout_s)

    def stop(self) -> None:
        """Begin to decelerate, at once; does nothing at rest or without a connection."""
        if self._link.is_open:
            self._link.ask("stopping")
            self._halt()

    def true_position(self) -> float:
        """Where the axis really is, its unit; the world sees this one."""
        return sum(carriage.true_position() for carriage in self.carriages)

    def _states(self) -> tuple[CarriageState, ...]:
        return tuple(carriage.state() for carriage in self.carriages)

    def _halt(self) -> None:
        for carriage in self.carriages:
            carriage.halt()

    def _require_inside(self, position: float, doing: str) -> None:
        limits = self._info.limits
        if not limits.contains(position):
            allowed = f"{limits.low:g} to {limits.high:g} {self._info.unit}"
            raise OutOfLimitsError(self.name, f"{doing}: outside its limits", f"choose a position from {allowed}")

    @contextmanager
    def _one_move(self, doing: str) -> Iterator[None]:
        if not self._moving.acquire(blocking=False):
            raise DeviceBusyError(self.name, f"{doing}: another move is under way", "wait for its end, or stop it")
        try:
            if _under_way(self._states()):
                raise DeviceBusyError(self.name, f"{doing}: it still moves", "wait until it is at rest, or stop it")
            yield
        finally:
            self._moving.release()

    def _duration_s(self, position: float) -> float:
        parts = zip(self.carriages, self._options.split(position), strict=True)
        return max(carriage.move_duration_s(part) for carriage, part in parts)

    def _timeout_s(self, duration_s: float) -> float:
        return self._options.timeout_factor * duration_s + self._options.timeout_margin_s

    def _finish(self, doing: str, timeout_s: float) -> None:
        """Wait until every motor is at rest, and raise what kept one from its target."""
        deadline_s = self._clock.now_s() + timeout_s
        while _under_way(states := self._states()):
            if self._link.is_open:
                self._link.ask(doing)
            if _alarm(states):
                self._halt()
            left_s = deadline_s - self._clock.now_s()
            if left_s <= 0.0:
                self._halt()
                self._clock.sleep(max(state.remaining_s for state in self._states()))
                raise DeviceTimeoutError(
                    self.name, f"{doing}: not there within {timeout_s:.1f} s", "look what blocks it, then home it"
                )
            remaining_s = max(state.remaining_s for state in states)
            self._clock.sleep(min(POLL_S, left_s, remaining_s or POLL_S))
        if alarm := _alarm(states):
            raise DeviceFaultError(self.name, f"{doing}: {alarm}", "free the axis, then move or home it again")
        if any(state.ending is Ending.STOPPED for state in states):
            where = f"{_position(states):g} {self._info.unit}"
            raise MoveStoppedError(self.name, f"{doing}: stopped on the way, reading {where}")


def _under_way(states: Sequence[CarriageState]) -> bool:
    return any(state.activity is not Activity.RESTING for state in states)


def _position(states: Sequence[CarriageState]) -> float:
    return round(sum(state.reading for state in states), 9)


def _alarm(states: Sequence[CarriageState]) -> str:
    return next((state.alarm for state in states if state.alarm), "")


def _axis_info(options: AnyAxisOptions, name: str) -> AxisInfo:
    specs = options.carriages()
    return AxisInfo(
        vendor="bscd",
        model=f"digital twin {options.quantity} axis",
        serial=f"twin-{name}",
        unit=_UNITS[options.quantity],
        limits=Range(sum(spec.limits.low for spec in specs), sum(spec.limits.high for spec in specs)),
        resolution=max(spec.resolution for spec in specs),
        repeatability=math.hypot(*(spec.repeatability for spec in specs)),
        speed=max(spec.speed for spec in specs),
        can_home=True,
    )
