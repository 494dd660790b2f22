"""One jack's drive: its commands and its state, in steps, by the register map."""

from __future__ import annotations

from dataclasses import dataclass

from pymodbus.client import ModbusTcpClient

from drivers.jacks.modbus.register_map import RegisterMap
from drivers.modbus import Line

_INT32, _UINT32 = ModbusTcpClient.DATATYPE.INT32, ModbusTcpClient.DATATYPE.UINT32


@dataclass(frozen=True, slots=True)
class DriveState:
    """What a drive tells of itself; ``position`` in steps."""

    position: int
    homed: bool
    moving: bool
    alarm: str


class Drive:
    """A drive on a line; every method raises the errors of `drivers.modbus.Line`.

    Parameters
    ----------
    label : str
        Which jack it is, for messages: "lower jack".
    line : Line
        Where it is.
    unit : int
        Its Modbus address.
    registers : RegisterMap
        What its words mean.
    """

    def __init__(self, label: str, line: Line, unit: int, registers: RegisterMap) -> None:
        self.label = label
        self._line = line
        self._unit = unit
        self._registers = registers

    def state(self, doing: str) -> DriveState:
        """State now; when it no longer moves, the position is that at rest."""
        registers = self._registers
        (outputs,) = self._line.read(self._unit, registers.outputs.address, 1, f"{doing} ({self.label})")
        alarm = ""
        if outputs & registers.outputs.alarm:
            alarm = registers.alarm.meaning(self._value(registers.alarm.address, _UINT32, doing))
        return DriveState(
            position=self._value(registers.position.address, _INT32, doing),
            homed=bool(outputs & registers.outputs.homed),
            moving=bool(outputs & registers.outputs.moving),
            alarm=alarm,
        )

    def release(self, doing: str) -> None:
        """Take back every command, also a stop."""
        self._command(self._registers.inputs.release, doing)

    def stop(self, doing: str) -> None:
        """Stop, and stay so until released."""
        self._command(self._registers.inputs.stop, doing)

    def reset_alarm(self, doing: str) -> None:
        """Clear an alarm whose cause is gone."""
        self._command(self._registers.inputs.alarm_reset, doing)
        self.release(doing)

    def begin_home(self, doing: str) -> None:
        """Set off to the reference position; the drive must be released."""
        self._command(self._registers.inputs.home, doing)

    def begin_move(self, position: int, speed: int, acceleration: int, doing: str) -> None:
        """Set off to ``position`` (steps) at ``speed`` (steps/s) with ``acceleration`` (steps/s^2)."""
        arguments = {
            "position": position,
            "speed": speed,
            "acceleration": acceleration,
            "deceleration": acceleration,
        }
        words: list[int] = []
        for value in self._registers.move.values:
            number = arguments[value] if isinstance(value, str) else value
            words += ModbusTcpClient.convert_to_registers(number, _INT32, self._registers.word_order)
        self._line.write(self._unit, self._registers.move.address, words, f"{doing} ({self.label})")

    def _command(self, word: int, doing: str) -> None:
        self._line.write(self._unit, self._registers.inputs.address, [word], f"{doing} ({self.label})")

    def _value(self, address: int, kind: ModbusTcpClient.DATATYPE, doing: str) -> int:
        words = self._line.read(self._unit, address, 2, f"{doing} ({self.label})")
        value = ModbusTcpClient.convert_from_registers(words, kind, self._registers.word_order)
        if not isinstance(value, int):
            raise TypeError(f"{value!r} is no 32-bit integer")
        return value
