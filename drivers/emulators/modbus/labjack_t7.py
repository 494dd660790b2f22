"""A LabJack T7 with a pressure transducer on AIN0 and a regulator on DAC0; addresses are the protocol table's."""

from __future__ import annotations

import struct
import threading
from dataclasses import dataclass

from drivers.clock import Clock, HostClock
from drivers.emulators.lines import TcpLine
from drivers.emulators.modbus.pdu import ILLEGAL_ADDRESS, ILLEGAL_VALUE, RefusedError
from drivers.emulators.modbus.sessions import TcpSession
from drivers.emulators.wire import WireFaults
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
DAC_LIMITS_V = (0.0, 5.0)
RANGES_V = (0.01, 0.1, 1.0, 10.0)


@dataclass(frozen=True)
class Wiring:
    """What is wired to the LabJack: transducer and regulator, volts to kPa."""

    transducer_v_at_0_kpa: float = 0.5
    transducer_v_per_kpa: float = 0.2
    regulator_kpa_per_v: float = 3.2
    """0 V is 0 kPa; the regulator goes as far as its supply."""


class LabJackT7Registers:
    """The registers in use; safe to use from any thread."""

    def __init__(self, source: SimulatedPressure, wiring: Wiring, clock: Clock) -> None:
        self._source = source
        self._wiring = wiring
        self._clock = clock
        self._lock = threading.Lock()
        self.power_up()

    def power_up(self) -> None:
        """What it is set to when powered: DAC0 at 0 V."""
        with self._lock:
            self._dac_v = 0.0
            self._settings = {AIN0_RANGE: 10.0, AIN0_NEGATIVE: 199, AIN0_RESOLUTION: 0, AIN0_SETTLING: 0.0}

    def read(self, address: int, count: int) -> list[int]:
        """Whole values from ``address`` on. Raises `RefusedError`."""
        words: list[int] = []
        while len(words) < count:
            words += self._value(address + len(words))
        if len(words) != count:
            raise RefusedError(ILLEGAL_VALUE)
        return words

    def write(self, address: int, words: list[int]) -> None:
        """Take one value. Raises `RefusedError`."""
        if address in (AIN0_NEGATIVE, AIN0_RESOLUTION) and len(words) == 1:
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
            if value == 0.0:
                self._source.vent()
            else:
                limits = self._source.info().limits_kpa
                self._source.set_pressure(min(value * self._wiring.regulator_kpa_per_v, limits.high))
        with self._lock:
            if address == DAC0:
                self._dac_v = value
            else:
                self._settings[address] = value

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
        floats = {PRODUCT_ID: PRODUCT, HARDWARE_VERSION: HARDWARE, FIRMWARE_VERSION: FIRMWARE}
        if address in floats:
            return _float_words(floats[address])
        integers = {TEST: TEST_PATTERN, SERIAL_NUMBER: SERIAL, CORE_TIMER: self._core_timer()}
        if address in integers:
            return list(struct.unpack(">HH", struct.pack(">I", integers[address])))
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
        Drives its core timer.
    """

    def __init__(
        self, source: SimulatedPressure, wiring: Wiring | None = None, *, port: int = 0, clock: Clock | None = None
    ) -> None:
        self.faults = WireFaults()
        self._source = source
        self._registers = LabJackT7Registers(source, wiring or Wiring(), clock or HostClock())
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

    def start(self) -> None:
        """Serve on loopback."""
        self._source.connect()
        self._line.start()

    def stop(self) -> None:
        """Stop serving, as pulling the network cable does; the regulator keeps its set-point."""
        self._line.stop()

    def power_cycle(self) -> None:
        """Switch off and on: DAC0 falls to 0 V, which vents, and connections break."""
        self._registers.power_up()
        self._source.vent()
        self._line.stop()
        self._line.start()


def _float_words(value: float) -> list[int]:
    return list(struct.unpack(">HH", struct.pack(">f", value)))
