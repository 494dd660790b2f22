"""One simulated motor with its controller: commands that return at once, a counter, a true position.

The counter shows the nominal position in whole steps; the true position is off by an error that is drawn anew
for every move (repeatability). Emulators put wire protocols in front of it, `SimulatedAxis` the blocking calls.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from drivers.clock import Clock
from drivers.errors import DeviceBusyError, NotHomedError
from drivers.interfaces import Range
from drivers.simulated.faults import Fault, Faults
from drivers.simulated.motion import Motion, at_rest, braking, duration_s, position_at, trapezoidal

STALL_NOTICED_AFTER_S = 0.3
LIMIT_SWITCH_HIT = "limit switch hit"
MOTOR_STALLED = "motor stalled"


@dataclass(frozen=True, slots=True)
class CarriageSpec:
    """A motor's mechanics; every length in the axis's unit (mm or deg)."""

    limits: Range
    resolution: float
    repeatability: float
    """One sigma of the true position about the counter's."""
    speed: float
    acceleration: float
    homing_speed: float
    home: float
    """Where the reference switch is."""
    start: float
    """Where the motor stands when powered."""
    homed: bool
    """Whether the counter is right when powered; it reads 0 otherwise."""


class Activity(StrEnum):
    """What a motor is doing."""

    RESTING = "resting"
    MOVING = "moving"
    HOMING = "homing"
    STOPPING = "stopping"
    STALLED = "stalled"
    """Standing still, not yet noticed."""
    HANGING = "hanging"
    """Standing still, and never noticed."""


class Ending(StrEnum):
    """Why a motor is at rest."""

    COMPLETED = "completed"
    STOPPED = "stopped"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class CarriageState:
    """What a motor's controller tells."""

    reading: float
    """The counter, in whole steps; right only when homed."""
    activity: Activity
    ending: Ending
    """Why it came to rest the last time."""
    alarm: str
    """In words; empty when there is none, and again once the motor sets off."""
    homed: bool
    remaining_s: float
    """Until the motion in progress should end; 0 at rest and when stuck."""


_NEXT = {
    Activity.RESTING: {Activity.MOVING, Activity.HOMING},
    Activity.MOVING: {Activity.RESTING, Activity.STOPPING, Activity.STALLED, Activity.HANGING},
    Activity.HOMING: {Activity.RESTING, Activity.STOPPING, Activity.STALLED, Activity.HANGING},
    Activity.STOPPING: {Activity.RESTING},
    Activity.STALLED: {Activity.RESTING},
    Activity.HANGING: {Activity.RESTING},
}


class Carriage:
    """A motor; safe to use from any thread.

    Parameters
    ----------
    name : str
        Name of the device it belongs to, for messages.
    spec : CarriageSpec
        Its mechanics.
    clock : Clock
        Drives the motion.
    faults : Faults
        The faults that may strike it.
    rng : numpy.random.Generator
        Draws the error of each move.
    """

    def __init__(self, name: str, spec: CarriageSpec, clock: Clock, faults: Faults, rng: np.random.Generator) -> None:
        self.spec = spec
        self._name = name
        self._clock = clock
        self._faults = faults
        self._rng = rng
        self._lock = threading.Lock()
        self._activity = Activity.RESTING
        self._ending = Ending.COMPLETED
        self._alarm = ""
        self._ends_at_switch = False
        self._motion = at_rest(spec.start)
        self._since_s = self._end_s = clock.now_s()
        self._error_from = self._error_to = 0.0
        self._homed = spec.homed
        self._counter_zero = 0.0 if spec.homed else spec.start

    def nearest(self, position: float) -> float:
        """The whole step within the limits that is nearest to ``position``."""
        steps = round(position / self.spec.resolution)
        for candidate in (steps, steps - 1, steps + 1):
            if self.spec.limits.contains(stepped := round(candidate * self.spec.resolution, 9)):
                return stepped
        return position

    def begin_move(self, position: float) -> None:
        """Set off to ``position``, inside the limits. Raises `NotHomedError` and `DeviceBusyError`."""
        with self._lock:
            self._update()
            self._require_resting()
            if not self._homed:
                raise NotHomedError(
                    self._name, f"moving to {position:g}: it does not know where it is", "home it first"
                )
            self._ends_at_switch = False
            self._set_off(Activity.MOVING, self.nearest(position), self.spec.speed)

    def drive_to(self, position: float, speed: float) -> None:
        """Set off to a place of the counter at ``speed`` (at most its own), homed or not, as a bare controller does.

        Where the travel ends before that place, so does the motion, in the alarm of a limit switch. Raises
        `DeviceBusyError`.
        """
        with self._lock:
            self._update()
            self._require_resting()
            limits, wanted = self.spec.limits, position + self._counter_zero
            end = min(max(wanted, limits.low), limits.high)
            self._ends_at_switch = abs(wanted - end) > self.spec.resolution / 2.0
            self._set_off(Activity.MOVING, self.nearest(end), min(speed, self.spec.speed))

    def power_cycle(self) -> None:
        """Switch off and on: it stands where it is, and forgets where that is unless it knew when powered first."""
        with self._lock:
            self._update()
            self._freeze()
            if self._activity is not Activity.RESTING:
                self._become(Activity.RESTING)
            self._ending, self._alarm = Ending.COMPLETED, ""
            self._homed = self.spec.homed
            self._counter_zero = 0.0 if self.spec.homed else self._motion.end

    def begin_home(self) -> None:
        """Set off to the reference switch; the counter is not to be trusted until there."""
        with self._lock:
            self._update()
            self._require_resting()
            self._homed = self._ends_at_switch = False
            self._set_off(Activity.HOMING, self.spec.home, self.spec.homing_speed)

    def halt(self) -> None:
        """Decelerate to rest; does nothing at rest."""
        with self._lock:
            self._update()
            if self._activity in (Activity.MOVING, Activity.HOMING):
                elapsed_s = self._elapsed_s()
                error = self._error(elapsed_s)
                motion = braking(self._motion, elapsed_s, self.spec.acceleration)
                self._become(Activity.STOPPING)
                self._run(motion, error, error)
            elif self._activity in (Activity.STALLED, Activity.HANGING):
                self._rest(Ending.STOPPED)
            self._update()

    def true_position(self) -> float:
        """Where it really is."""
        with self._lock:
            self._update()
            elapsed_s = self._elapsed_s()
            return position_at(self._motion, elapsed_s) + self._error(elapsed_s)

    def state(self) -> CarriageState:
        """What the controller tells, all of the same instant."""
        with self._lock:
            self._update()
            under_way = self._activity is not Activity.RESTING
            return CarriageState(
                reading=self._reading(),
                activity=self._activity,
                ending=self._ending,
                alarm=self._alarm,
                homed=self._homed,
                remaining_s=max(0.0, self._end_s - self._clock.now_s()) if under_way else 0.0,
            )

    def move_duration_s(self, position: float) -> float:
        """Seconds of a move from the counter's position to ``position``."""
        with self._lock:
            self._update()
            start = self._reading()
        return duration_s(trapezoidal(start, self.nearest(position), self.spec.speed, self.spec.acceleration))

    def longest_homing_s(self) -> float:
        """Seconds of a search for the reference switch from the far end of the travel."""
        limits, home = self.spec.limits, self.spec.home
        far = limits.high if limits.high - home > home - limits.low else limits.low
        return duration_s(trapezoidal(far, home, self.spec.homing_speed, self.spec.acceleration))

    def _update(self) -> None:
        """Bring the state up to the clock; the lock is held."""
        if self._activity in (Activity.MOVING, Activity.HOMING):
            if self._faults.strike(Fault.LIMIT_HIT):
                self._freeze()
                self._rest(Ending.FAULT, LIMIT_SWITCH_HIT)
                return
            if self._faults.strike(Fault.STALLED_MOVE):
                self._freeze()
                self._become(Activity.STALLED)
            elif self._faults.strike(Fault.HANGING_MOVE):
                self._freeze()
                self._become(Activity.HANGING)
        if self._activity is Activity.STALLED and self._elapsed_s() >= STALL_NOTICED_AFTER_S:
            self._rest(Ending.FAULT, MOTOR_STALLED)
        running = self._activity in (Activity.MOVING, Activity.HOMING, Activity.STOPPING)
        if running and self._clock.now_s() >= self._end_s:
            if self._activity is Activity.HOMING:
                self._homed, self._counter_zero = True, 0.0
            if self._activity is Activity.STOPPING:
                self._rest(Ending.STOPPED)
            elif self._ends_at_switch:
                self._rest(Ending.FAULT, LIMIT_SWITCH_HIT)
            else:
                self._rest(Ending.COMPLETED)

    def _require_resting(self) -> None:
        if self._activity is not Activity.RESTING:
            raise DeviceBusyError(self._name, f"it is {self._activity}", "wait until it is at rest, or stop it")

    def _set_off(self, activity: Activity, end: float, speed: float) -> None:
        start = self._motion.end
        self._alarm = ""
        self._become(activity)
        error = self._error_to if end == start else float(self._rng.normal(0.0, self.spec.repeatability))
        self._run(trapezoidal(start, end, speed, self.spec.acceleration), self._error_to, error)
        self._update()

    def _run(self, motion: Motion, error_from: float, error_to: float) -> None:
        self._motion, self._since_s = motion, self._clock.now_s()
        self._end_s = self._since_s + duration_s(motion)
        self._error_from, self._error_to = error_from, error_to

    def _freeze(self) -> None:
        """Stand still at once where it is."""
        elapsed_s = self._elapsed_s()
        error = self._error(elapsed_s)
        self._run(at_rest(position_at(self._motion, elapsed_s)), error, error)

    def _rest(self, ending: Ending, alarm: str = "") -> None:
        self._become(Activity.RESTING)
        self._run(at_rest(self._motion.end), self._error_to, self._error_to)
        self._ending, self._alarm = ending, alarm

    def _become(self, activity: Activity) -> None:
        if activity not in _NEXT[self._activity]:
            raise RuntimeError(f"{self._name}: {self._activity} can not become {activity}")
        self._activity = activity

    def _elapsed_s(self) -> float:
        return self._clock.now_s() - self._since_s

    def _reading(self) -> float:
        nominal = position_at(self._motion, self._elapsed_s()) - self._counter_zero
        return round(round(nominal / self.spec.resolution) * self.spec.resolution, 9)

    def _error(self, elapsed_s: float) -> float:
        """The error shifts evenly from the last move's to this one's, so that the true position has no jump."""
        total_s = duration_s(self._motion)
        share = 1.0 if elapsed_s >= total_s else max(0.0, elapsed_s / total_s)
        return self._error_from + share * (self._error_to - self._error_from)
