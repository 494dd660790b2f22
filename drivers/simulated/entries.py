"""What the registry knows of the simulated devices."""

from __future__ import annotations

from drivers.registry import DriverContext, DriverEntry
from drivers.simulated.axis import SimulatedAxis
from drivers.simulated.camera import SimulatedCamera
from drivers.simulated.options import SimulatedAxisOptions, SimulatedCameraOptions, SimulatedPressureOptions
from drivers.simulated.pressure import SimulatedPressure


def _build_axis(options: SimulatedAxisOptions, context: DriverContext) -> SimulatedAxis:
    return SimulatedAxis(options.root, context)


CAMERA = DriverEntry("camera", SimulatedCameraOptions, SimulatedCamera, "a camera that sees the digital twin")
AXIS = DriverEntry("axis", SimulatedAxisOptions, _build_axis, "a stage or the lab jacks of the digital twin")
PRESSURE = DriverEntry("pressure", SimulatedPressureOptions, SimulatedPressure, "the digital twin's pressure source")
