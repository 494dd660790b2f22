"""What the simulated devices need of the physical world; the digital twin's `World` provides it."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.errors import NotConnectedError
from drivers.registry import DriverContext
from drivers.twin.options import TwinOptions

CameraName = Literal["primary", "auxiliary"]
Quantity = Literal["rotation_deg", "translation_mm", "jack_mm", "pressure_kpa"]


class SensorGeometry(Protocol):
    """The part of a camera's optics that its identity tells."""

    @property
    def width_px(self) -> int:
        """Columns of the sensor."""
        ...

    @property
    def height_px(self) -> int:
        """Rows of the sensor."""
        ...

    @property
    def pixel_size_mm(self) -> float:
        """Edge of a square pixel."""
        ...


class PhysicalWorld(Protocol):
    """One physical state, shared by all devices of a rig."""

    options: TwinOptions
    """What the world was made of; cameras take the bits of a pixel from it."""

    def bind(self, quantity: Quantity, source: Callable[[], float]) -> None:
        """Let ``source`` say what a quantity truly is, now and whenever it is asked."""
        ...

    def state(self) -> Hashable:
        """Where everything stands now; the images of equal states differ by noise only."""
        ...

    def optics(self, camera: CameraName) -> SensorGeometry:
        """Lens and sensor of a camera."""
        ...

    def expose(
        self, camera: CameraName, *, exposure_s: float, gain_db: float, rng: np.random.Generator
    ) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """What the sensor reads now, ``(height, width)``, noise included."""
        ...


def world_of(context: DriverContext) -> PhysicalWorld:
    """The world that a device is built into. Raises `NotConnectedError` when there is none."""
    if context.world is None:
        raise NotConnectedError(
            context.name, "a simulated device needs the digital twin", "build it with the twin's world"
        )
    return context.world
