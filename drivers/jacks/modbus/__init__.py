"""The lab jacks on Modbus drives (Oriental Motor AZ by default), RTU or TCP."""

from drivers.jacks.modbus.axis import ModbusJacks
from drivers.jacks.modbus.entry import AXIS
from drivers.jacks.modbus.options import ModbusJackOptions, ModbusJacksOptions
from drivers.jacks.modbus.register_map import RegisterMap, load_register_map, shipped_maps

__all__ = [
    "AXIS",
    "ModbusJackOptions",
    "ModbusJacks",
    "ModbusJacksOptions",
    "RegisterMap",
    "load_register_map",
    "shipped_maps",
]
