"""A pressure transducer and a regulator behind a LabJack T7 (Modbus TCP)."""

from drivers.pressure.labjack_t7.entry import PRESSURE
from drivers.pressure.labjack_t7.options import InputOptions, LabJackT7Options, RegulatorOptions, TransducerOptions
from drivers.pressure.labjack_t7.source import LabJackT7Pressure
from drivers.pressure.labjack_t7.transducer import Transducer

__all__ = [
    "PRESSURE",
    "InputOptions",
    "LabJackT7Options",
    "LabJackT7Pressure",
    "RegulatorOptions",
    "Transducer",
    "TransducerOptions",
]
