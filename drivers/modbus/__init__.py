"""The host's end of a Modbus line, RTU or TCP, around pymodbus's client; shared by the jacks and the LabJack."""

from drivers.modbus.line import Line
from drivers.modbus.port import Address, SerialSettings

__all__ = ["Address", "Line", "SerialSettings"]
