"""The rig that the daemon owns: its devices behind the e-stop's latch, real ones or the twin's."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

from bscd.composition import build_devices, build_world
from bscd.config import RigConfig, parse_config
from bscd.daemon.guards import GuardedAxis, GuardedPressure, Latch, WatchedCamera
from bscd.daemon.latest import LatestFrames
from bscd.daemon.recipes import Specimen
from bscd.errors import InputError
from bscd.procedures import Rig
from drivers.clock import Clock
from drivers.errors import DeviceError
from drivers.interfaces import Axis, Camera, PressureSource
from drivers.operator import Operator

if TYPE_CHECKING:
    from drivers.emulators.rig import EmulatedRig

_SPECIMENS: Mapping[Specimen, str] = {
    "cube": "the calibration cube",
    "sphere": "the sphere",
    "membrane": "the membrane in its clamp",
}


class Bench:
    """Builds the devices; connects none. `close` releases them all.

    ``emulate`` puts the configuration's twin behind its wire protocols, in this process, and drives it with the real
    drivers. Raises `InputError` where there is no twin to do so with, or a part of it can not be served.
    """

    def __init__(
        self,
        config: RigConfig,
        config_text: str,
        clock: Clock,
        latest: LatestFrames,
        operator: Operator,
        *,
        emulate: bool = False,
    ) -> None:
        self.config, self.config_text = config, config_text
        self.world = build_world(config, clock)
        self._emulated: EmulatedRig | None = None
        try:
            if emulate:
                self._emulate(clock)
            world = None if emulate else self.world
            devices = build_devices(self.config, clock, world, operator)
        except BaseException:
            self._end_twin()
            raise
        self.latch = Latch()
        self.drivers = {name: device for name, device in devices.items() if device is not None}
        self.rig = Rig(
            primary=WatchedCamera(devices["primary"], latest),
            auxiliary=None if devices["auxiliary"] is None else WatchedCamera(devices["auxiliary"], latest),
            rotation=GuardedAxis(devices["rotation"], self.latch),
            translation=GuardedAxis(devices["translation"], self.latch),
            jacks=GuardedAxis(devices["jacks"], self.latch),
            pressure=None if devices["pressure"] is None else GuardedPressure(devices["pressure"], self.latch),
            clock=clock,
            origin_mm=config.scan.origin_mm,
            raised_mm=config.prism.raised_mm,
            lowered_mm=config.prism.lowered_mm,
        )

    @property
    def stop_commands(self) -> dict[str, Callable[[], object]]:
        """What the e-stop gives each device, past everything else."""
        axes = {name: self.drivers[name].stop for name in ("rotation", "translation", "jacks")}
        return axes if self.rig.pressure is None else {"pressure": self.drivers["pressure"].vent, **axes}

    def lost(self, names: Iterable[str] | None = None) -> list[str]:
        """Those of the devices (None: of all) that are not connected, by role."""
        roles = self.rig.devices
        return [name for name in (roles if names is None else names) if name in roles and not _connected(roles[name])]

    def vent(self) -> None:
        """Let the pressure out. Raises `drivers.errors.DeviceError`."""
        if self.rig.pressure is not None and self.rig.pressure.info().can_set:
            self.rig.pressure.vent()

    def place(self, specimen: Specimen) -> str:
        """Put it into the volume: the twin does so by itself (""); else what the operator is to confirm.

        The twin's first image of it is rendered at once: it takes longer than a camera may be silent.
        """
        if self.world is None:
            return f"put {_SPECIMENS[specimen]} into the volume"
        self.world.place(specimen)
        self.world.irradiance("primary")
        return ""

    def close(self) -> None:
        """Vent, stop and release every device; never raises."""
        self.rig.close()
        self._end_twin()

    def _emulate(self, clock: Clock) -> None:
        if self.world is None:
            raise InputError("an emulated rig needs a [twin] section in its configuration; take config/twin.toml")
        from bscd.composition.emulated import emulated_devices, real_configuration  # the emulators are no rig's need
        from drivers.emulators.rig import EmulatedRig

        self._emulated = EmulatedRig(emulated_devices(self.config, clock, self.world), first_port=None)
        missing = self._emulated.start()
        if missing:
            raise InputError(f"the rig can not be emulated: {'; '.join(missing)}")
        real = real_configuration(self.config_text, self._emulated.configuration())
        self.config = parse_config(real, "the emulated rig's configuration")
        self.config_text = real

    def _end_twin(self) -> None:
        if self._emulated is not None:
            self._emulated.stop()
        if self.world is not None:
            self.world.close()


def _connected(device: Camera | Axis | PressureSource) -> bool:
    if isinstance(device, GuardedPressure):
        try:
            device.read()
        except DeviceError:
            return False
        return True
    return getattr(device, "status")().connected  # noqa: B009 - cameras and axes both have one
