"""What the registry knows of the LabJack."""

from __future__ import annotations

from drivers.pressure.labjack_t7.options import LabJackT7Options
from drivers.pressure.labjack_t7.source import LabJackT7Pressure
from drivers.registry import DriverEntry

PRESSURE = DriverEntry("pressure", LabJackT7Options, LabJackT7Pressure, "regulator and transducer on a LabJack T7")
