"""One axis of a Zaber device as a stage's controller: its settings, its position in microsteps, its faults in words."""

from __future__ import annotations

import threading

from drivers.stages.controller import Identity, MotorState
from drivers.stages.line import BadAnswerError, LineLostError, RefusedError
from drivers.stages.zaber.dialogue import Dialogue, join, leave
from drivers.stages.zaber.messages import (
    FAULTS,
    INTERRUPTED,
    NO_FLAG,
    UNREFERENCED,
    Reply,
    native_acceleration,
    native_speed,
)
from drivers.stages.zaber.options import ZaberOptions

WHOLE_DEVICE = 0


class ZaberController:
    """One axis of one device; see `drivers.stages.controller.StageController`."""

    def __init__(self, options: ZaberOptions) -> None:
        self._options = options
        self._sense = -1 if options.reversed else 1
        self.microsteps_per_unit = self._sense * options.microsteps_per_unit
        low, high = options.limits
        self.longest_homing_s = (high - low) / options.homing_speed + 2.0 * options.homing_speed / options.acceleration
        self.longest_approach_s = 0.0
        self._offset = round(options.home_position * self.microsteps_per_unit)
        self._joined = threading.Lock()
        self._dialogue: Dialogue | None = None

    def open(self) -> Identity:
        """Join the line, have replies checked, ask who is there, and give it the settings of the options."""
        options = self._options
        with self._joined:
            if self._dialogue is None or self._dialogue.lost:
                self._leave()
                self._dialogue = join(options.port, baud=options.baud, timeout_s=options.answer_timeout_s)
        self._ask("set comm.checksum 1", axis=WHOLE_DEVICE, unchecked=True)
        device, version = (self._ask(f"get {name}", axis=WHOLE_DEVICE).data for name in ("deviceid", "version"))
        serial = self._ask("get system.serial", axis=WHOLE_DEVICE).data
        self._require_travel()
        self._configure()
        return Identity("Zaber", f"device {device}", serial, version)

    def close(self) -> None:
        """Leave the line."""
        with self._joined:
            self._leave()

    def state(self) -> MotorState:
        """The position with what the device is doing, and all its warnings where it has one."""
        reply = self._ask("get pos")
        flags = [] if reply.flag == NO_FLAG else self._ask("warnings").data.split()[1:]
        return MotorState(
            count=self._number(reply) + self._offset,
            moving=reply.busy,
            homed=not UNREFERENCED.intersection(flags),
            fault="; ".join(FAULTS.get(flag, f"fault {flag}") for flag in flags if flag in FAULTS or flag[0] == "F"),
            interrupted=not reply.busy and INTERRUPTED in flags,
        )

    def prepare(self) -> bool:
        """Clear the warnings of the past; settings survive a power cycle, and that is told by a warning."""
        self._ask("warnings clear")
        self._configure()
        return True

    def begin_move(self, count: int) -> None:
        """Set off to a position."""
        self._ask(f"move abs {count - self._offset}")

    def begin_home(self) -> None:
        """Set off to the reference."""
        self._ask("home")

    def end_home(self) -> None:
        """Nothing: the device gives its reference its position itself."""

    def halt(self) -> None:
        """Decelerate to rest."""
        self._ask("stop")

    def _leave(self) -> None:
        if self._dialogue is not None:
            leave(self._dialogue)
            self._dialogue = None

    def _ask(self, command: str, *, axis: int | None = None, unchecked: bool = False) -> Reply:
        dialogue = self._dialogue
        if dialogue is None:
            raise LineLostError("the port is closed")
        options = self._options
        axis = options.axis if axis is None else axis
        return dialogue.ask(options.address, axis, command, timeout_s=options.answer_timeout_s, unchecked=unchecked)

    def _number(self, reply: Reply) -> int:
        try:
            return int(reply.data)
        except ValueError as err:
            raise BadAnswerError(f"{reply.data!r} is no whole number") from err

    def _configure(self) -> None:
        options = self._options
        for name, wanted in {
            "maxspeed": native_speed(options.speed * options.microsteps_per_unit),
            "accel": native_acceleration(options.acceleration * options.microsteps_per_unit),
        }.items():
            # kept in the device's flash memory: written only where it differs
            if self._number(self._ask(f"get {name}")) != wanted:
                self._ask(f"set {name} {wanted}")

    def _require_travel(self) -> None:
        """Refuse limits beyond the device's own."""
        least, most = (self._number(self._ask(f"get limit.{end}")) + self._offset for end in ("min", "max"))
        ends = [round(limit * self.microsteps_per_unit) for limit in self._options.limits]
        if min(ends) < least or max(ends) > most:
            own = sorted(count / self.microsteps_per_unit for count in (least, most))
            raise RefusedError(f"it travels from {own[0]:g} to {own[1]:g} {self._options.unit} only")
