"""The lab jacks and the LabJack T7 behind their real Modbus, with framing of its own: no driver's error is shared."""

from drivers.emulators.modbus.jacks import ModbusJacksEmulator
from drivers.emulators.modbus.labjack_t7 import LabJackT7Emulator

__all__ = ["LabJackT7Emulator", "ModbusJacksEmulator"]
