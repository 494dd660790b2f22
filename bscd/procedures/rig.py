"""The rig as procedures see it: its devices, its clock, and where the scan and the biprism stand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

from bscd.errors import BscdError
from drivers.clock import Clock
from drivers.errors import DeviceError
from drivers.interfaces import Axis, Camera, PressureSource

CameraRole = Literal["primary", "auxiliary"]
AxisRole = Literal["jacks", "translation", "rotation"]


class RigNotReadyError(BscdError):
    """One or more devices did not do what was asked of all; ``failures`` are their errors by device name."""

    def __init__(self, doing: str, failures: Mapping[str, DeviceError], of: int) -> None:
        self.failures = dict(failures)
        told = " | ".join(str(error) for error in self.failures.values())
        super().__init__(f"{doing}: {len(self.failures)} of {of} devices failed: {told}")


@dataclass(frozen=True)
class Rig:
    """The devices of a biprism rig and the numbers of its geometry that a scan needs.

    ``origin_mm`` is the translation stage's reading at POS.0; ``raised_mm`` and ``lowered_mm`` are the jacks'
    heights with the biprism fully in and fully out of the primary camera's view.
    """

    primary: Camera
    auxiliary: Camera | None
    rotation: Axis
    translation: Axis
    jacks: Axis
    pressure: PressureSource | None
    clock: Clock
    origin_mm: float
    raised_mm: float
    lowered_mm: float

    @property
    def cameras(self) -> dict[CameraRole, Camera]:
        """The cameras there are, by their role: "primary", "auxiliary"."""
        both: dict[CameraRole, Camera | None] = {"primary": self.primary, "auxiliary": self.auxiliary}
        return {role: camera for role, camera in both.items() if camera is not None}

    @property
    def axes(self) -> dict[AxisRole, Axis]:
        """The axes by their role, in the order in which they are homed: the biprism first."""
        return {"jacks": self.jacks, "translation": self.translation, "rotation": self.rotation}

    @property
    def devices(self) -> dict[str, Camera | Axis | PressureSource]:
        """Every device there is, by its role."""
        pressure = {} if self.pressure is None else {"pressure": self.pressure}
        return {**self.cameras, **self.axes, **pressure}

    def connect(self) -> None:
        """Connect every device. Raises `RigNotReadyError` that names all that did not answer, not only the first.

        Those that did answer stay connected, so that the rest can be looked after and `connect` called again.
        """
        devices = self.devices
        failures = gather_failures({role: device.connect for role, device in devices.items()})
        if failures:
            raise RigNotReadyError("connecting", failures, len(devices))

    def close(self) -> None:
        """Release every device; never raises."""
        for device in self.devices.values():
            device.close()

    def stop_axes(self) -> None:
        """Stop every axis, whatever the others do; never raises."""
        for axis in self.axes.values():
            with suppress(DeviceError):
                axis.stop()


def gather_failures(actions: Mapping[str, Callable[[], object]]) -> dict[str, DeviceError]:
    """Do all of these, one after the other, and return the errors of those that failed, by name."""
    failures: dict[str, DeviceError] = {}
    for name, action in actions.items():
        try:
            action()
        except DeviceError as error:
            failures[name] = error
    return failures
