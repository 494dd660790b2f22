"""What the registry knows of the Modbus jacks."""

from __future__ import annotations

from drivers.jacks.modbus.axis import ModbusJacks
from drivers.jacks.modbus.options import ModbusJacksOptions
from drivers.registry import DriverEntry

AXIS = DriverEntry("axis", ModbusJacksOptions, ModbusJacks, "the lab jacks on Modbus drives, RTU or TCP")
