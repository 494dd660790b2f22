"""A whole rig on the digital twin in virtual time, with a coarse sensor so that rendering is quick."""

from dataclasses import replace

from bscd.calibration import GridTarget
from bscd.procedures import Rig
from drivers.clock import VirtualClock
from drivers.registry import DriverContext
from drivers.simulated import SimulatedAxis, SimulatedCamera
from drivers.simulated.options import JackOptions, RotationOptions, SimulatedCameraOptions, TranslationOptions
from drivers.twin.options import TwinOptions
from drivers.twin.world import World

TARGET = GridTarget()


class TwinRig:
    """The rig and what tests reach behind it: the clock and the world."""

    def __init__(self, *, homed: bool = True, options: TwinOptions | None = None, **rig: float) -> None:
        coarse = {"pixel_size_mm": 0.0134, "width_px": 640, "height_px": 512}
        given = options or TwinOptions()
        self.options = given.model_copy(
            update={name: getattr(given, name).model_copy(update=coarse) for name in ("primary", "auxiliary")}
        )
        self.clock = VirtualClock()
        self.world = World(self.options, clock=self.clock)

        def context(name: str) -> DriverContext:
            return DriverContext(name, self.clock, self.world)

        self.rig = Rig(
            primary=SimulatedCamera(SimulatedCameraOptions(camera="primary"), context("primary")),
            auxiliary=SimulatedCamera(SimulatedCameraOptions(camera="auxiliary"), context("auxiliary")),
            rotation=SimulatedAxis(RotationOptions(homed_at_start=homed), context("rotation")),
            translation=SimulatedAxis(TranslationOptions(homed_at_start=homed), context("translation")),
            jacks=SimulatedAxis(JackOptions(homed_at_start=homed), context("jacks")),
            pressure=None,
            clock=self.clock,
            origin_mm=50.0,
            raised_mm=70.0,
            lowered_mm=5.0,
        )
        self.rig = replace(self.rig, **rig)
        self.rig.connect()

    def positions(self) -> dict[str, float]:
        return {role: axis.status().position for role, axis in self.rig.axes.items()}

    def moving(self) -> bool:
        return any(axis.status().moving for axis in self.rig.axes.values())
