"""A LabJack T7 with a pressure transducer on AIN0 and a regulator on DAC0; addresses are the protocol table's.

Its watchdog is that of the T-Series Datasheet, section 23, with the registers of LabJack's Modbus map.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from drivers.clock import Appointment, Clock, HostClock
from drivers.emulators.lines import TcpLine
from drivers.emulators.modbus.pdu import ILLEGAL_ADDRESS, ILLEGAL_VALUE, RefusedError
from drivers.emulators.modbus.sessions import TcpSession
from drivers.emulators.wire import WireFaults
from drivers.errors import DeviceError
from drivers.simulated.pressure import SimulatedPressure

UNIT = 1
CONNECTIONS = 2
PRODUCT, HARDWARE, FIRMWARE, SERIAL = 7.0, 1.35, 1.0312, 470012345
TEST_PATTERN = 0x00112233
CORE_TIMER_HZ = 40_000_000
AIN0, AIN0_RANGE, AIN0_NEGATIVE, AIN0_RESOLUTION, AIN0_SETTLING = 0, 40000, 41000, 41500, 42000
DAC0, TEST, PRODUCT_ID, HARDWARE_VERSION, FIRMWARE_VERSION, SERIAL_NUMBER, CORE_TIMER = (
    1000,
    55100,
    60000,
    60002,
    60004,
    60028,
    61520,
)
WATCHDOG_ENABLE, WATCHDOG_TIMEOUT_S, WATCHDOG_STARTUP_DELAY_S = 61600, 61604, 61606
WATCHDOG_STRICT_ENABLE, WATCHDOG_STRICT_KEY, WATCHDOG_STRICT_CLEAR = 61610, 61612, 61614
WATCHDOG_DAC0_ENABLE, WATCHDOG_DAC0 = 61640, 61642
WATCHDOG_NOT_WIRED = (61602, 61620, 61630, 61632, 61634, 61636, 61650, 61652)
"""IO configuration, reset, digital lines and DAC1: kept, and not done."""
WATCHDOG_END = 61654
WATCHDOG_FIRMWARE = 1.0016
DEVICE_FAILURE = 4
DAC_LIMITS_V = (0.0, 5.0)
RANGES_V = (0.01, 0.1, 1.0, 10.0)


@dataclass(frozen=True)
class Wiring:
    """What is wired to the LabJack: transducer and regulator, volts to kPa."""

    transducer_v_at_0_kpa: float = 0.5
    transducer_v_per_kpa: float = 0.2
    regulator_kpa_per_v: float = 3.2
    """0 V is 0 kPa; the regulator goes as far as its supply."""


class Watchdog:
    """Sets DAC0 when nothing has been answered for its time-out; safe to use from any thread.

    Once it has acted it acts again only after another answer, for nothing can have changed before.

    Parameters
    ----------
    clock : Clock
        The T7's own.
    set_dac0 : callable
        Sets DAC0 to volts.

    Attributes
    ----------
    flash_writes : int
        How often its settings, which stay when the power goes, have been written.
    """

    def __init__(self, clock: Clock, set_dac0: Callable[[float], None]) -> None:
        self.flash_writes = 0
        self._clock = clock
        self._set_dac0 = set_dac0
        self._lock = threading.Lock()
        kept = (
            WATCHDOG_ENABLE,
            WATCHDOG_TIMEOUT_S,
            WATCHDOG_STARTUP_DELAY_S,
            WATCHDOG_STRICT_ENABLE,
            WATCHDOG_STRICT_KEY,
            WATCHDOG_DAC0_ENABLE,
            WATCHDOG_DAC0,
            *WATCHDOG_NOT_WIRED,
        )
        self._settings = dict.fromkeys(kept, 0)
        self._cleared_s = 0.0
        self._period_s = 0
        self._appointment: Appointment | None = None

    def power_up(self) -> None:
        """Begin with the delay at start-up, which counts until it is cleared for the first time."""
        with self._lock:
            self._cancel()
            self._begin(self._settings[WATCHDOG_STARTUP_DELAY_S] or self._settings[WATCHDOG_TIMEOUT_S])

    def answered(self) -> None:
        """Note that an answer was sent, which clears it, except in strict mode."""
        with self._lock:
            if self._settings[WATCHDOG_STRICT_ENABLE]:
                self._schedule()
            else:
                self._begin(self._settings[WATCHDOG_TIMEOUT_S])

    def read(self, address: int) -> int:
        """A setting, 32 bits. Raises `RefusedError`."""
        with self._lock:
            if address not in self._settings:
                raise RefusedError(ILLEGAL_ADDRESS)
            return self._settings[address]

    def write(self, address: int, value: int) -> None:
        """Take a setting, only while disabled, or the key that clears it. Raises `RefusedError`."""
        with self._lock:
            if address == WATCHDOG_STRICT_CLEAR:
                if value == self._settings[WATCHDOG_STRICT_KEY]:
                    self._begin(self._settings[WATCHDOG_TIMEOUT_S])
                return
            if address not in self._settings:
                raise RefusedError(ILLEGAL_ADDRESS)
            if address == WATCHDOG_DAC0 and not DAC_LIMITS_V[0] <= _float_of(value) <= DAC_LIMITS_V[1]:
                raise RefusedError(ILLEGAL_VALUE)
            if address != WATCHDOG_ENABLE and self._settings[WATCHDOG_ENABLE]:
                raise RefusedError(DEVICE_FAILURE)
            self.flash_writes += 1
            self._settings[address] = value
            if address == WATCHDOG_ENABLE:
                self._cancel()
                self._begin(self._settings[WATCHDOG_TIMEOUT_S])

    def _begin(self, period_s: int) -> None:
        if period_s < self._period_s:
            self._cancel()
        self._cleared_s, self._period_s = self._clock.now_s(), period_s
        self._schedule()

    def _schedule(self) -> None:
        """Look when it may be due; a look that was agreed on before is early and looks again. The lock is held."""
        if self._settings[WATCHDOG_ENABLE] and self._period_s and self._appointment is None:
            self._appointment = self._clock.call_at(self._cleared_s + self._period_s, self._look)

    def _cancel(self) -> None:
        if self._appointment is not None:
            self._appointment.cancel()
            self._appointment = None

    def _look(self) -> None:
        with self._lock:
            self._appointment = None
            if not self._settings[WATCHDOG_ENABLE]:
                return
            now_s = self._clock.now_s()
            if now_s < self._cleared_s + self._period_s:
                self._schedule()
                return
            self._cleared_s, self._period_s = now_s, self._settings[WATCHDOG_TIMEOUT_S]
            acts, volts = self._settings[WATCHDOG_DAC0_ENABLE], _float_of(self._settings[WATCHDOG_DAC0])
        if acts:
            self._set_dac0(volts)


class LabJackT7Registers:
    """The registers in use; safe to use from any thread."""

    def __init__(self, source: SimulatedPressure, wiring: Wiring, clock: Clock, firmware: float = FIRMWARE) -> None:
        self._source = source
        self._wiring = wiring
        self._clock = clock
        self._firmware = firmware
        self._lock = threading.Lock()
        self.watchdog = Watchdog(clock, self._time_out)
        self.power_up()

    def power_up(self) -> None:
        """What it is set to when powered: DAC0 at 0 V, and the watchdog as it was."""
        with self._lock:
            self._dac_v = 0.0
            self._settings = {AIN0_RANGE: 10.0, AIN0_NEGATIVE: 199, AIN0_RESOLUTION: 0, AIN0_SETTLING: 0.0}
        self.watchdog.power_up()

    def read(self, address: int, count: int) -> list[int]:
        """Whole values from ``address`` on. Raises `RefusedError`."""
        words: list[int] = []
        try:
            while len(words) < count:
                words += self._value(address + len(words))
            if len(words) != count:
                raise RefusedError(ILLEGAL_VALUE)
            return words
        finally:
            self.watchdog.answered()

    def write(self, address: int, words: list[int]) -> None:
        """Take one value. Raises `RefusedError`."""
        try:
            self._write(address, words)
        finally:
            self.watchdog.answered()

    def _write(self, address: int, words: list[int]) -> None:
        if self._is_watchdogs(address) and len(words) == 2:
            self.watchdog.write(address, words[0] << 16 | words[1])
        elif address in (AIN0_NEGATIVE, AIN0_RESOLUTION) and len(words) == 1:
            with self._lock:
                self._settings[address] = words[0]
        elif address in (DAC0, AIN0_RANGE, AIN0_SETTLING) and len(words) == 2:
            self._write_float(address, struct.unpack(">f", struct.pack(">HH", *words))[0])
        else:
            raise RefusedError(ILLEGAL_ADDRESS)

    def _write_float(self, address: int, value: float) -> None:
        if address == AIN0_RANGE and min(abs(value - known) for known in RANGES_V) > 1e-6:
            raise RefusedError(ILLEGAL_VALUE)
        if address == DAC0:
            if not DAC_LIMITS_V[0] <= value <= DAC_LIMITS_V[1]:
                raise RefusedError(ILLEGAL_VALUE)
            self._set_dac0(value)
            return
        with self._lock:
            self._settings[address] = value

    def _set_dac0(self, volts: float) -> None:
        if volts == 0.0:
            self._source.vent()
        else:
            limits = self._source.info().limits_kpa
            self._source.set_pressure(min(volts * self._wiring.regulator_kpa_per_v, limits.high))
        with self._lock:
            self._dac_v = volts

    def _time_out(self, volts: float) -> None:
        with suppress(DeviceError):  # a twin that has been switched off has nothing to vent
            self._set_dac0(volts)

    def _is_watchdogs(self, address: int) -> bool:
        return WATCHDOG_ENABLE <= address < WATCHDOG_END and self._firmware >= WATCHDOG_FIRMWARE

    def _value(self, address: int) -> list[int]:
        with self._lock:
            if address in (AIN0_NEGATIVE, AIN0_RESOLUTION):
                return [int(self._settings[address])]
            if address in (AIN0_RANGE, AIN0_SETTLING):
                return _float_words(self._settings[address])
            if address == DAC0:
                return _float_words(self._dac_v)
        if address == AIN0:
            kpa = self._source.read().pressure_kpa
            return _float_words(self._wiring.transducer_v_at_0_kpa + self._wiring.transducer_v_per_kpa * kpa)
        if self._is_watchdogs(address):
            return _integer_words(self.watchdog.read(address))
        floats = {PRODUCT_ID: PRODUCT, HARDWARE_VERSION: HARDWARE, FIRMWARE_VERSION: self._firmware}
        if address in floats:
            return _float_words(floats[address])
        integers = {TEST: TEST_PATTERN, SERIAL_NUMBER: SERIAL, CORE_TIMER: self._core_timer()}
        if address in integers:
            return _integer_words(integers[address])
        raise RefusedError(ILLEGAL_ADDRESS)

    def _core_timer(self) -> int:
        return round(self._clock.now_s() * CORE_TIMER_HZ) % 2**32


class LabJackT7Emulator:
    """See `drivers.emulators.emulator.Emulator`.

    Parameters
    ----------
    source : SimulatedPressure
        Regulator and transducer on the twin.
    wiring : Wiring
        What is wired to the LabJack.
    port : int
        TCP port; 0 takes a free one (a real T7 has 502).
    clock : Clock
        Drives its core timer and its watchdog.
    firmware : float
        Its version; the watchdog came with 1.0016.
    """

    def __init__(
        self,
        source: SimulatedPressure,
        wiring: Wiring | None = None,
        *,
        port: int = 0,
        clock: Clock | None = None,
        firmware: float = FIRMWARE,
    ) -> None:
        self.faults = WireFaults()
        self._source = source
        self._registers = LabJackT7Registers(source, wiring or Wiring(), clock or HostClock(), firmware)
        units = {UNIT: self._registers}
        self._line = TcpLine(lambda: TcpSession(units), self.faults, port=port, clients=CONNECTIONS)

    @property
    def address(self) -> str:
        """What the driver is given."""
        return self._line.address

    @property
    def summary(self) -> str:
        """What it is."""
        return "pressure, LabJack T7, Modbus TCP, transducer on AIN0, regulator on DAC0"

    @property
    def watchdog_writes(self) -> int:
        """How often the watchdog's settings have been written to flash."""
        return self._registers.watchdog.flash_writes

    def start(self) -> None:
        """Serve on loopback."""
        self._source.connect()
        self._line.start()

    def stop(self) -> None:
        """Stop serving, as pulling the network cable does; the regulator keeps its set-point, the watchdog runs on."""
        self._line.stop()

    def power_cycle(self) -> None:
        """Switch off and on: DAC0 falls to 0 V, which vents, and connections break."""
        self._registers.power_up()
        self._source.vent()
        self._line.stop()
        self._line.start()


def _float_words(value: float) -> list[int]:
    return list(struct.unpack(">HH", struct.pack(">f", value)))


def _integer_words(value: int) -> list[int]:
    return [value >> 16, value & 0xFFFF]


def _float_of(bits: int) -> float:
    return struct.unpack(">f", struct.pack(">I", bits))[0]
