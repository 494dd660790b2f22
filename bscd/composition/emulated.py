"""A configuration's rig behind its real wire protocols: simulated devices, and a configuration of the real drivers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bscd.config import RigConfig
from bscd.config.load import DEVICE_KINDS
from drivers.clock import Clock
from drivers.emulators.rig import smallest_step
from drivers.registry import DriverContext, installed_drivers


def emulated_devices(config: RigConfig, clock: Clock, world: Any) -> dict[str, Any]:
    """Simulated devices for a configuration's names, its stages as fine as their controllers count."""
    registry = installed_drivers()
    devices: dict[str, Any] = {}
    for name, kind in DEVICE_KINDS.items():
        driver = f"{kind}.simulated"
        section = getattr(config.devices, name)
        if section is None:
            devices[name] = None
            continue
        given = section.options.model_dump() if section.driver == driver else {}
        if kind == "camera":
            given = {"camera": name, **given}
        if kind == "axis":
            quantity = {"jacks": "jack"}.get(name, name)
            given = {"quantity": quantity, **given}
            if name in ("rotation", "translation"):
                unit = "deg" if name == "rotation" else "mm"
                given[f"resolution_{unit}"] = smallest_step(name)
        devices[name] = registry[driver].build(given, DriverContext(name, clock, world))
    return devices


def real_configuration(text: str, devices: Mapping[str, Mapping[str, Any]]) -> str:
    """A configuration's text with other devices and without the twin: what is behind real drivers is not simulated."""
    kept, skipping = [], False
    for line in text.splitlines():
        if line.startswith("["):
            skipping = line.startswith(("[devices", "[twin"))
        if not skipping:
            kept.append(line)
    for name, section in devices.items():
        kept += ["", *_section(f"devices.{name}", section)]
    return "\n".join(kept).strip() + "\n"


def _section(name: str, values: Mapping[str, Any]) -> list[str]:
    tables = {key: value for key, value in values.items() if isinstance(value, Mapping)}
    lines = [f"[{name}]", *(f"{key} = {_toml(value)}" for key, value in values.items() if key not in tables)]
    for key, table in tables.items():
        lines += ["", *_section(f"{name}.{key}", table)]
    return lines


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml(one) for one in value) + "]"
    return repr(value)
