"""Devices on the digital twin's world: motion, limits, homing, exposure, noise, pressure, and faults on command."""

from drivers.simulated.axis import SimulatedAxis
from drivers.simulated.camera import SimulatedCamera
from drivers.simulated.faults import Fault, Faults
from drivers.simulated.options import (
    JackOptions,
    RotationOptions,
    SimulatedAxisOptions,
    SimulatedCameraOptions,
    SimulatedPressureOptions,
    TranslationOptions,
)
from drivers.simulated.pressure import SimulatedPressure

__all__ = [
    "Fault",
    "Faults",
    "JackOptions",
    "RotationOptions",
    "SimulatedAxis",
    "SimulatedAxisOptions",
    "SimulatedCamera",
    "SimulatedCameraOptions",
    "SimulatedPressure",
    "SimulatedPressureOptions",
    "TranslationOptions",
]
