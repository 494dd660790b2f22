"""A Zaber device: its settings, its axes, its warnings.

What differs from a real one: a motion that is ordered during another one is rejected instead of taking over, and
homing goes straight to the simulated stage's reference place, at its speed. It reads 0 there.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence

from drivers.emulators.wire import WireFaults
from drivers.emulators.zaber.session import Outcome
from drivers.errors import DeviceBusyError
from drivers.simulated.carriage import LIMIT_SWITCH_HIT, Activity, Carriage, Ending

VELOCITY_SCALE = 16384 / 10000
"""Units of a velocity per microstep/s; an acceleration's unit is ten thousand times this one."""
MOST_SPEED = 2**31 - 1
DEVICE_ID = 30222
FIRMWARE = "7.38"


class _AxisOfDevice:
    """One motor, and the warnings and settings that belong to it."""

    def __init__(self, motor: Carriage, microsteps_per_unit: float) -> None:
        self.motor = motor
        self.scale = microsteps_per_unit
        self._home = round(motor.spec.home * microsteps_per_unit)
        speed = round(motor.spec.speed * microsteps_per_unit * VELOCITY_SCALE)
        acceleration = round(motor.spec.acceleration * microsteps_per_unit * VELOCITY_SCALE / 10000)
        self.settings = {
            "maxspeed": speed,
            "accel": acceleration,
            "limit.approach.maxspeed": round(motor.spec.homing_speed * microsteps_per_unit * VELOCITY_SCALE),
            "limit.min": round(motor.spec.limits.low * microsteps_per_unit) - self._home,
            "limit.max": round(motor.spec.limits.high * microsteps_per_unit) - self._home,
            "resolution": 64,
        }
        self._stopped = False
        self._seen = False

    @property
    def busy(self) -> bool:
        return self.motor.state().activity is not Activity.RESTING

    @property
    def count(self) -> int:
        return round(self.motor.state().reading * self.scale) - self._home

    def flags(self) -> list[str]:
        """The warnings, gravest first."""
        state = self.motor.state()
        flags = []
        if state.ending is Ending.FAULT and state.alarm and not self._seen:
            flags.append("FE" if state.alarm == LIMIT_SWITCH_HIT else "FS")
        if not state.homed:
            flags.append("WR")
        if self._stopped:
            flags.append("NI")
        return flags

    def forget(self) -> None:
        """Clear the warnings that speak of the past."""
        self._seen, self._stopped = not self.busy, False

    def halt(self) -> None:
        if self.busy:
            self._stopped = True
        self.motor.halt()

    def set_off(self, words: list[str]) -> str:
        """Begin a motion; why not, if not."""
        if self.busy:
            return "STATUSBUSY"
        try:
            return self._set_off(words)
        except DeviceBusyError:  # its other controller was first
            return "STATUSBUSY"

    def _set_off(self, words: list[str]) -> str:
        match words:
            case ["home"]:
                self._begin()
                self.motor.begin_home()
                return ""
            case ["move", "abs", data]:
                target = data
            case ["move", "rel", data] if _is_whole(data):
                target = str(self.count + int(data))
            case ["move", ("min" | "max") as end]:
                target = str(self.settings[f"limit.{end}"])
            case _:
                return "BADCOMMAND"
        if not _is_whole(target) or not self.settings["limit.min"] <= int(target) <= self.settings["limit.max"]:
            return "BADDATA"
        self._begin()
        # the microstep that is nearest to a limit may lie beyond it, by a part of one
        limits = self.motor.spec.limits
        place = min(max((int(target) + self._home) / self.scale, limits.low), limits.high)
        self.motor.drive_to(place, self.settings["maxspeed"] / VELOCITY_SCALE / self.scale)
        return ""

    def _begin(self) -> None:
        self._seen = self._stopped = False


class ZaberDevice:
    """One device at one address; safe to use from any thread.

    Parameters
    ----------
    address : int
        1 to 99.
    motors : sequence of Carriage
        The simulated motors of its axes 1, 2, ...
    microsteps_per_unit : float
        Microsteps per mm or deg.
    serial_number : int
        What it tells as its own.

    Attributes
    ----------
    faults : WireFaults
        Strike its own replies only, beside those of its line.
    """

    def __init__(
        self, address: int, motors: Sequence[Carriage], microsteps_per_unit: float, serial_number: int
    ) -> None:
        self.address = address
        self.faults = WireFaults()
        self._axes = [_AxisOfDevice(motor, microsteps_per_unit) for motor in motors]
        self._lock = threading.Lock()
        self._settings = {
            "comm.checksum": "0",
            "comm.address": str(address),
            "deviceid": str(DEVICE_ID),
            "system.serial": str(serial_number),
            "system.axiscount": str(len(motors)),
            "version": FIRMWARE,
        }

    @property
    def checks(self) -> bool:
        """Whether its replies bear check digits."""
        return self._settings["comm.checksum"] == "1"

    def power_cycle(self) -> None:
        """Switch off and on: settings stay, the reference does not."""
        with self._lock:
            for axis in self._axes:
                axis.motor.power_cycle()
                axis.forget()

    def run(self, axis: int, words: list[str]) -> Outcome:
        """Carry out a command."""
        with self._lock:
            if axis > len(self._axes):
                return Outcome("BADAXIS", rejected=True)
            meant = self._axes if axis == 0 else [self._axes[axis - 1]]
            data, rejected = self._carry_out(axis, meant, words)
            flags = [flag for one in meant for flag in one.flags()]
            return Outcome(data, rejected, any(one.busy for one in meant), flags[0] if flags else "--")

    def _carry_out(self, axis: int, meant: list[_AxisOfDevice], words: list[str]) -> tuple[str, bool]:
        match words:
            case []:
                return "0", False
            case ["get", name]:
                return self._get(axis, meant, name)
            case ["set", name, data]:
                return self._set(axis, meant, name, data)
            case ["warnings"] | ["warnings", "clear"]:
                flags = sorted({flag for one in meant for flag in one.flags()}, key=_gravity)
                if len(words) == 2:
                    for one in meant:
                        one.forget()
                return " ".join((f"{len(flags):02d}", *flags)), False
            case ["stop"]:
                for one in meant:
                    one.halt()
                return "0", False
            case _:
                reasons = [reason for one in meant if (reason := one.set_off(words))]
                return (reasons[0], True) if reasons else ("0", False)

    def _get(self, axis: int, meant: list[_AxisOfDevice], name: str) -> tuple[str, bool]:
        if name in self._settings:
            return ("DEVICEONLY", True) if axis else (self._settings[name], False)
        if name == "pos":
            return " ".join(str(one.count) for one in meant), False
        if name in meant[0].settings:
            return " ".join(str(one.settings[name]) for one in meant), False
        return "BADCOMMAND", True

    def _set(self, axis: int, meant: list[_AxisOfDevice], name: str, data: str) -> tuple[str, bool]:
        if name == "comm.checksum":
            if axis:
                return "DEVICEONLY", True
            if data not in ("0", "1"):
                return "BADDATA", True
            self._settings[name] = data
            return "0", False
        if name not in meant[0].settings:
            return "BADCOMMAND", True
        if not _is_whole(data) or (name == "maxspeed" and not 1 <= int(data) <= MOST_SPEED):
            return "BADDATA", True
        for one in meant:
            one.settings[name] = int(data)
        return "0", False


def _is_whole(text: str) -> bool:
    return text.removeprefix("-").isdigit()


def _gravity(flag: str) -> tuple[int, str]:
    return "FWN".index(flag[0]), flag
