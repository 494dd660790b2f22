"""A LabJack T7 by its Modbus registers (labjack.com, T-Series Modbus map): who it is, AIN in, DAC0 out."""

from __future__ import annotations

import math

from pymodbus.client import ModbusTcpClient

from drivers.clock import Clock
from drivers.errors import DeviceFaultError, NotConnectedError, ProtocolError
from drivers.modbus import Line, SerialSettings
from drivers.pressure.labjack_t7.options import InputOptions

UNIT = 1
DAC0 = 1000
AIN, AIN_RANGE, AIN_NEGATIVE, AIN_RESOLUTION, AIN_SETTLING = 0, 40000, 41000, 41500, 42000
TEST, TEST_PATTERN = 55100, 0x00112233
PRODUCT_ID, PRODUCT_T7 = 60000, 7
FIRMWARE_VERSION = 60004
SERIAL_NUMBER = 60028
DAC_TOLERANCE_V = 0.002
OVER_RANGE = 1.05
"""What a reading may be of its range; beyond it the T7 tells nothing."""

_FLOAT32, _UINT32 = ModbusTcpClient.DATATYPE.FLOAT32, ModbusTcpClient.DATATYPE.UINT32


class LabJackT7:
    """One T7 on the network; safe to use from any thread. Every method raises the errors of `drivers.modbus.Line`.

    Parameters
    ----------
    device : str
        Name of the device, for messages.
    options : InputOptions
        Where it is, and how its analog input is set up; done again whenever the connection has been made.
    clock : Clock
        The frames' clock.

    Attributes
    ----------
    serial, firmware : str
        Its own, once connected.
    connections : int
        How often the connection has been made.
    """

    def __init__(self, device: str, options: InputOptions, clock: Clock) -> None:
        self._device = device
        self._options = options
        self._clock = clock
        self.serial = ""
        self.firmware = ""
        self.connections = 0
        self.line = Line(
            device, options.address, SerialSettings(), options.answer_timeout_s, clock, greet=self._recognise
        )

    def volts(self, doing: str) -> tuple[float, float]:
        """The transducer's output, V, and when it was read, s of the clock: the middle of the exchange.

        Raises `ProtocolError` for what no input can read.
        """
        with self.line.alone(UNIT, doing):
            began_s = self._clock.now_s()
            volts = self._read_float(AIN + 2 * self._options.channel, doing)
            ended_s = self._clock.now_s()
        if not abs(volts) <= OVER_RANGE * self._options.range_v:
            raise ProtocolError(
                self._device, f"{doing}: {volts:g} V lies outside the input's range", "check range_v and the wiring"
            )
        return volts, (began_s + ended_s) / 2.0

    def dac_volts(self, doing: str) -> float:
        """What DAC0 is set to, V."""
        volts = self._read_float(DAC0, doing)
        if not math.isfinite(volts):
            raise ProtocolError(self._device, f"{doing}: DAC0 tells {volts} V", "look what else writes to it")
        return volts

    def set_dac_volts(self, volts: float, doing: str) -> None:
        """Set DAC0 and read it back. Raises `DeviceFaultError` when it stays at something else."""
        self._write_float(DAC0, volts, doing)
        told = self.dac_volts(doing)
        if abs(told - volts) > DAC_TOLERANCE_V:
            words = f"{doing}: DAC0 was set to {volts:.4g} V and reads {told:.4g} V"
            raise DeviceFaultError(self._device, words, "look what else writes to it")

    def read_uint(self, address: int, doing: str) -> int:
        """The unsigned 32-bit value at an address."""
        words = self.line.read(UNIT, address, 2, doing)
        value = ModbusTcpClient.convert_from_registers(words, _UINT32, "big")
        return value if isinstance(value, int) else -1

    def write_uint(self, address: int, value: int, doing: str) -> None:
        """Write an unsigned 32-bit value."""
        self.line.write(UNIT, address, ModbusTcpClient.convert_to_registers(value, _UINT32, "big"), doing)

    def _recognise(self) -> None:
        """See that it is the right T7 and set its input up."""
        doing = "asking who is there"
        pattern = self.read_uint(TEST, doing)
        if pattern != TEST_PATTERN:
            words = f"{doing}: its test register reads 0x{pattern:08X}, so it is no LabJack"
            raise NotConnectedError(self._device, words, "check the address")
        product = self._read_float(PRODUCT_ID, doing)
        if round(product) != PRODUCT_T7:
            raise NotConnectedError(self._device, f"{doing}: it is a T{product:g}, not a T7", "check the address")
        self.serial = str(self.read_uint(SERIAL_NUMBER, doing))
        self.firmware = f"{self._read_float(FIRMWARE_VERSION, doing):.4f}"
        wanted = self._options.serial_number
        if wanted is not None and self.serial != str(wanted):
            words = f"{doing}: it is the T7 with serial number {self.serial}, not {wanted}"
            raise NotConnectedError(self._device, words, "check the address")
        self._set_up()
        self.connections += 1

    def _set_up(self) -> None:
        doing, options = "setting up its input", self._options
        channel = options.channel
        self._write_float(AIN_RANGE + 2 * channel, options.range_v, doing)
        self.line.write(UNIT, AIN_NEGATIVE + channel, [options.negative_channel], doing)
        self.line.write(UNIT, AIN_RESOLUTION + channel, [options.resolution_index], doing)
        self._write_float(AIN_SETTLING + 2 * channel, options.settling_us, doing)

    def _read_float(self, address: int, doing: str) -> float:
        words = self.line.read(UNIT, address, 2, doing)
        value = ModbusTcpClient.convert_from_registers(words, _FLOAT32, "big")
        return value if isinstance(value, float) else math.nan

    def _write_float(self, address: int, value: float, doing: str) -> None:
        self.line.write(UNIT, address, ModbusTcpClient.convert_to_registers(value, _FLOAT32, "big"), doing)
