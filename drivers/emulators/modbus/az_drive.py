"""The registers of an Oriental Motor AZ drive in front of a simulated motor; the addresses are the protocol table's.

It reads 0 at its home, as a drive does whose home has no position of its own.
"""

from __future__ import annotations

import threading

from drivers.emulators.modbus.pdu import ILLEGAL_ADDRESS, RefusedError
from drivers.simulated.carriage import LIMIT_SWITCH_HIT, Activity, Carriage

DIRECT_DATA = range(0x0058, 0x0068)
DRIVER_INPUT = 0x007D
DRIVER_OUTPUT = 0x007F
PRESENT_ALARM = 0x0080
COMMAND_POSITION = 0x00C6
FEEDBACK_POSITION = 0x00CC

IN_ZHOME, IN_STOP, IN_ALM_RST = 1 << 4, 1 << 5, 1 << 7
OUT_HOME_END, OUT_READY, OUT_ALM_A, OUT_MOVE, OUT_IN_POS = 1 << 4, 1 << 5, 1 << 7, 1 << 13, 1 << 14

ALARM_OVERLOAD = 0x30
ALARM_NOT_HOMED = 0x4A
ALARM_HARDWARE_OVERTRAVEL = 0x66
ALARM_SOFTWARE_OVERTRAVEL = 0x67
ALARM_OPERATION_DATA = 0x70

ABSOLUTE = 1
TRIGGER_ALL = 1


class AzDrive:
    """One drive; safe to use from any thread.

    Parameters
    ----------
    carriage : Carriage
        The motor.
    steps_per_mm : float
        What the drive is set to.
    """

    def __init__(self, carriage: Carriage, steps_per_mm: float) -> None:
        self._carriage = carriage
        self._steps_per_mm = steps_per_mm
        self._lock = threading.Lock()
        self._forget()

    def read(self, address: int, count: int) -> list[int]:
        """The words at ``address``. Raises `RefusedError` for an address that the drive does not have."""
        with self._lock:
            words = self._words()
        try:
            return [words[address + offset] for offset in range(count)]
        except KeyError:
            raise RefusedError(ILLEGAL_ADDRESS) from None

    def write(self, address: int, words: list[int]) -> None:
        """Take words and do what they ask for. Raises `RefusedError`."""
        written = range(address, address + len(words))
        with self._lock:
            if address == DRIVER_INPUT and len(words) == 1:
                self._take_inputs(words[0])
            elif written[0] in DIRECT_DATA and written[-1] in DIRECT_DATA:
                for place, word in zip(written, words, strict=True):
                    self._direct[place - DIRECT_DATA[0]] = word
                if DIRECT_DATA[-1] in written and self._value(7) == TRIGGER_ALL:
                    self._operate()
            else:
                raise RefusedError(ILLEGAL_ADDRESS)

    def power_cycle(self) -> None:
        """Switch off and on."""
        with self._lock:
            self._carriage.power_cycle()
            self._forget()

    def _forget(self) -> None:
        self._direct = [0] * len(DIRECT_DATA)
        self._inputs = 0
        self._own_alarm = 0
        self._reset_alarm = ""
        self._commanded = 0

    def _value(self, index: int) -> int:
        """A value of the direct data operation: two's complement, upper word first."""
        upper, lower = self._direct[2 * index : 2 * index + 2]
        value = upper << 16 | lower
        return value - (1 << 32) if value >= 1 << 31 else value

    def _take_inputs(self, inputs: int) -> None:
        risen = inputs & ~self._inputs
        self._inputs = inputs
        if risen & IN_STOP:
            self._carriage.halt()
        if risen & IN_ALM_RST:
            self._own_alarm = 0
            self._reset_alarm = self._carriage.state().alarm
        if risen & IN_ZHOME and self._may_start():
            self._reset_alarm = ""
            self._carriage.begin_home()
            self._commanded = 0

    def _operate(self) -> None:
        if not self._may_start():
            return
        _, kind, position, speed, start_rate, stop_rate, current, _ = (self._value(index) for index in range(8))
        spec = self._carriage.spec
        place_mm = round(spec.home + position / self._steps_per_mm, 9)
        if kind != ABSOLUTE or speed <= 0 or min(start_rate, stop_rate) <= 0 or not 0 < current <= 1000:
            self._own_alarm = ALARM_OPERATION_DATA
        elif not self._carriage.state().homed:
            self._own_alarm = ALARM_NOT_HOMED
        elif not spec.limits.contains(place_mm):
            self._own_alarm = ALARM_SOFTWARE_OVERTRAVEL
        else:
            self._reset_alarm = ""
            self._commanded = position
            self._carriage.drive_to(place_mm, speed / self._steps_per_mm)

    def _may_start(self) -> bool:
        resting = self._carriage.state().activity is Activity.RESTING
        return resting and not self._alarm() and not self._inputs & IN_STOP

    def _alarm(self) -> int:
        if self._own_alarm:
            return self._own_alarm
        alarm = self._carriage.state().alarm
        if not alarm or alarm == self._reset_alarm:
            return 0
        return ALARM_HARDWARE_OVERTRAVEL if alarm == LIMIT_SWITCH_HIT else ALARM_OVERLOAD

    def _words(self) -> dict[int, int]:
        state, alarm = self._carriage.state(), self._alarm()
        moving = state.activity is not Activity.RESTING
        outputs = (
            (OUT_HOME_END if state.homed else 0)
            | (OUT_READY if self._may_start() else 0)
            | (OUT_ALM_A if alarm else 0)
            | (OUT_MOVE if moving else OUT_IN_POS)
        )
        words = dict(zip(DIRECT_DATA, self._direct, strict=True))
        words |= {DRIVER_INPUT - 1: 0, DRIVER_INPUT: self._inputs, DRIVER_OUTPUT - 1: 0, DRIVER_OUTPUT: outputs}
        for place, value in (
            (PRESENT_ALARM, alarm),
            (COMMAND_POSITION, self._commanded),
            (FEEDBACK_POSITION, round((state.reading - self._carriage.spec.home) * self._steps_per_mm)),
        ):
            words[place], words[place + 1] = value >> 16 & 0xFFFF, value & 0xFFFF
        return words
