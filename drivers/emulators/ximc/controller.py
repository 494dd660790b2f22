"""An XIMC controller: its settings, its counter in steps and microsteps, and the motor it drives.

What differs from a real one: homing goes straight to the simulated stage's reference place, at its speed, whatever
``shom`` says; a move that arrives during another one ends in an error instead of taking over. Where the motor has a
second controller, of another maker, this one is homed by its own homing only: its counter has a zero of its own.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.emulators.ximc.messages import ClippedError
from drivers.errors import DeviceBusyError
from drivers.simulated.carriage import LIMIT_SWITCH_HIT, Activity, Carriage, CarriageState, Ending

FINEST = 256
"""Parts of a step that the counter keeps, whatever the microstep mode is."""
MOVE_CODES = {"move": 1, "movr": 2, "left": 3, "rigt": 4, "stop": 5, "home": 6, "loft": 7, "sstp": 8}
COMPLAINTS = {"errc": 0x1, "errd": 0x2, "errv": 0x4}
RUNNING, FAILED = 0x80, 0x40
IS_HOMED, ALARM, CTP_ERROR = 0x20, 0x40, 0x80
RIGHT_EDGE, LEFT_EDGE = 0x1, 0x2
NORMAL_POWER = 3
MOST_STEPS_S = 100_000

_DEFAULTS: dict[str, tuple[int | bytes, ...]] = {
    "mov": (2000, 0, 4000, 4000, 1000, 0, 0),
    "eng": (2400, 670, 5000, 0, 0x10, 0, 9, 200, 0),
    "ent": (3, 3),
    "eds": (0x6, 0, 0, 0, 0, 0),
    "hom": (500, 0, 50, 0, 0, 0, 0x110),
    "fbs": (4000, 4, 0, 4000),
    "pwr": (50, 1000, 60, 300, 0),
    "nmf": (b"", 0),
    "nme": (b"",),
}


class XimcController:
    """One controller with its motor; safe to use from any thread.

    Parameters
    ----------
    motor : Carriage
        The simulated motor.
    steps_per_unit : float
        Full steps per mm or deg of the motor's axis.
    serial_number : int
        What it tells as its own.
    """

    def __init__(self, motor: Carriage, steps_per_unit: float, serial_number: int) -> None:
        self._motor = motor
        self._parts_per_unit = steps_per_unit * FINEST
        self._steps_per_unit = steps_per_unit
        self._serial_number = serial_number
        self._lock = threading.RLock()
        self._saved = dict(_DEFAULTS)
        self._begin()

    def _begin(self) -> None:
        self._settings = dict(self._saved)
        self._offset = 0
        self._command = 0
        self._failed = self._alarm = self._jolted = False
        self._complaints = 0
        self._homed = self._motor.state().homed
        self._offset_at_home: int | None = None

    def power_cycle(self) -> None:
        """Switch off and on: saved settings only, counter at 0, not homed."""
        with self._lock:
            self._motor.power_cycle()
            self._begin()

    def complain(self, code: str) -> None:
        """Set the status flag of an error answer; it stays until the controller is switched off."""
        with self._lock:
            self._complaints |= COMPLAINTS[code]

    def read(self, code: str) -> tuple[int | bytes, ...]:
        """The fields of an answer."""
        with self._lock:
            if code == "gets":
                return self._status()
            if code == "gpos":
                return (*self._place(self._motor.state()), 0)
            if code == "geti":
                return (b"XIMC", b"SM", b"8SMC5", 5, 0, 0)
            if code == "gser":
                return (self._serial_number,)
            if code in ("gfwv", "gblv"):
                return (4, 6, 6)
            return self._settings[code[1:]]

    def write(self, code: str, fields: tuple[int | bytes, ...]) -> None:
        """Carry out an order that brings values. Raises `ClippedError`."""
        with self._lock:
            if code in ("move", "movr"):
                steps, parts = (int(field) for field in fields)
                self._set_off(code, steps * FINEST + parts * FINEST // self._division())
            elif code == "spos":
                steps, parts, _, flags = (int(field) for field in fields)
                if not flags & 1:
                    self._set_counter(steps * FINEST + parts * FINEST // self._division())
            else:
                self._set(code[1:], fields)

    def do(self, code: str) -> None:
        """Carry out an order without values."""
        with self._lock:
            if code == "zero":
                self._set_counter(0)
            elif code == "save":
                self._saved = dict(self._settings)
            elif code == "read":
                self._settings = dict(self._saved)
            elif code in ("stop", "sstp"):
                self._halt(code)
            elif code == "home":
                self._home()
            elif code in ("left", "rigt"):
                far = -(2**31) if code == "left" else 2**31
                self._set_off(code, far)
            elif code == "loft":
                self._set_off(code, self._count(self._motor.state()))

    def _set(self, name: str, fields: tuple[int | bytes, ...]) -> None:
        clipped = False
        if name == "mov" and int(fields[0]) > MOST_STEPS_S:
            fields, clipped = (MOST_STEPS_S, *fields[1:]), True
        if name == "eng" and not 1 <= int(fields[6]) <= 9:
            fields, clipped = (*fields[:6], 9, *fields[7:]), True
        self._settings[name] = fields
        if clipped:
            raise ClippedError

    def _division(self) -> int:
        """Microsteps per step of the mode that is set: 1 (full steps) to 256."""
        return 2 ** (int(self._settings["eng"][6]) - 1)

    def _count(self, state: CarriageState) -> int:
        if not state.homed:
            self._homed = False
        elif self._offset_at_home is not None:  # its homing is done, and the motor's reading has a new zero
            self._offset, self._offset_at_home, self._homed = self._offset_at_home, None, True
        return round(state.reading * self._parts_per_unit) + self._offset

    def _set_counter(self, count: int) -> None:
        self._offset += count - self._count(self._motor.state())

    def _place(self, state: CarriageState) -> tuple[int, int]:
        """The counter in steps and microsteps, both of its sign."""
        count = self._count(state)
        microsteps = abs(count) * self._division() // FINEST
        steps, parts = divmod(microsteps, self._division())
        return (steps, parts) if count >= 0 else (-steps, -parts)

    def _set_off(self, code: str, count: int) -> None:
        if not self._ready_for(code):
            return
        if code == "movr":
            count += self._count(self._motor.state())
        speed = int(self._settings["mov"][0]) / self._steps_per_unit
        with self._fails_when_busy():
            self._motor.drive_to((count - self._offset) / self._parts_per_unit, speed)

    def _home(self) -> None:
        if self._ready_for("home"):
            home = self._motor.spec.home
            way = home - self._motor.true_position()
            # homing does not touch the counter; the motor's own starts anew there
            ends_at = self._count(self._motor.state()) + round(way * self._parts_per_unit)
            with self._fails_when_busy():
                self._motor.begin_home()
                self._offset_at_home = ends_at - round(home * self._parts_per_unit)
                self._jolted = False

    @contextmanager
    def _fails_when_busy(self) -> Iterator[None]:
        """Its other controller was first."""
        try:
            yield
        except DeviceBusyError:
            self._failed = True

    def _ready_for(self, code: str) -> bool:
        """Whether a motion can begin; it ends in an error at once when not."""
        self._settle()
        self._command = MOVE_CODES[code]
        self._failed = self._alarm or self._motor.state().activity is not Activity.RESTING
        return not self._failed

    def _halt(self, code: str) -> None:
        self._settle()
        moving = self._motor.state().activity is not Activity.RESTING
        if code == "stop":
            self._alarm = False
            self._jolted = self._jolted or moving
        if moving:
            self._command = MOVE_CODES[code]
            self._offset_at_home = None
        self._motor.halt()

    def _settle(self) -> None:
        """Take over what became of the last motion."""
        state = self._motor.state()
        if state.activity is not Activity.RESTING:
            return
        self._count(state)
        self._offset_at_home = None
        if state.ending is Ending.FAULT and state.alarm and not self._failed:
            self._failed = True
            self._alarm = state.alarm != LIMIT_SWITCH_HIT

    def _status(self) -> tuple[int | bytes, ...]:
        self._settle()
        state = self._motor.state()
        running = state.activity is not Activity.RESTING
        command = self._command | (RUNNING if running else 0) | (FAILED if self._failed else 0)
        flags = self._complaints
        steps, parts = self._place(state)
        flags |= IS_HOMED if self._homed and not self._jolted else 0
        flags |= ALARM | CTP_ERROR if self._alarm else 0
        edges = 0
        if state.alarm == LIMIT_SWITCH_HIT:
            middle = (self._motor.spec.limits.low + self._motor.spec.limits.high) / 2.0
            edges = RIGHT_EDGE if self._motor.true_position() > middle else LEFT_EDGE
        speed = int(self._settings["mov"][0]) if running else 0
        moving = 3 if running else 0
        return (
            *(moving, command, NORMAL_POWER, 0, 0),
            *(steps, parts, 0, speed, 0),
            *(120, 2400, 80, 500, 300),
            *(flags, edges, 255),
        )
