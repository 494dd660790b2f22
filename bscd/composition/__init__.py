"""The composition root: from a configuration to connected drivers, through the registry."""

from __future__ import annotations

from typing import Any

from bscd.config import RigConfig
from bscd.config.load import DEVICE_KINDS, WORLD_DRIVER
from drivers.clock import Clock
from drivers.operator import Operator
from drivers.registry import DriverContext, installed_drivers


def build_world(config: RigConfig, clock: Clock) -> Any:
    """The digital twin's world, or None where the configuration has no [twin]."""
    if config.twin is None:
        return None
    return installed_drivers()[WORLD_DRIVER].factory(config.twin, DriverContext("twin", clock))


def build_devices(
    config: RigConfig, clock: Clock, world: Any = None, operator: Operator | None = None
) -> dict[str, Any]:
    """The configured devices by their names in the configuration; None for those that are left out.

    ``operator`` is who answers what a driver has to ask a person.
    """
    registry = installed_drivers()
    devices: dict[str, Any] = {}
    for name in DEVICE_KINDS:
        chosen = getattr(config.devices, name)
        context = DriverContext(name, clock, world, operator)
        devices[name] = None if chosen is None else registry[chosen.driver].factory(chosen.options, context)
    return devices
