"""What the sections of a configuration must agree on: the devices reach what the scan and the prism ask for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel, RootModel

from bscd.config.model import DeviceConfig, RigConfig
from drivers.interfaces import Range

_SIMULATED = {
    "primary": ("camera", "primary"),
    "auxiliary": ("camera", "auxiliary"),
    "rotation": ("quantity", "rotation"),
    "translation": ("quantity", "translation"),
    "jacks": ("quantity", "jack"),
    "pressure": ("", ""),
}

_UNITS = {"rotation": "deg", "translation": "mm"}


def disagreements(config: RigConfig) -> list[str]:
    """One sentence for everything in a configuration that does not fit the rest of it."""
    return [*_wrong_parts(config), *_out_of_reach(config)]


def _wrong_parts(config: RigConfig) -> Iterator[str]:
    """Devices of another kind than their name says, and simulated ones without a world to see."""
    blind = []
    for name, (option, part) in _SIMULATED.items():
        device: DeviceConfig | None = getattr(config.devices, name)
        if device is None or ".simulated" not in device.driver:
            continue
        blind.append(name)
        given = getattr(_options(device), option, part)
        if given != part:
            yield f"[devices.{name}] {option} = {given!r}: must be {part!r} here"
    for name, unit in _UNITS.items():
        device = getattr(config.devices, name)
        given = getattr(_options(device), "unit", unit)
        if given != unit:
            yield f"[devices.{name}] unit = {given!r}: must be {unit!r} here"
    if blind and config.twin is None:
        yield f"[devices.{blind[0]}] is simulated, but there is no [twin] section for it to see; add one"


def _out_of_reach(config: RigConfig) -> Iterator[str]:
    """Positions, exposures and gains outside the limits that a driver's options state.

    A driver whose limits are known only once it is connected is checked by the scan's dry run.
    """
    scan, prism = config.scan, config.prism
    half_mm = scan.step_mm * (scan.positions - 1) / 2
    turns_deg = sorted((scan.corner_rotation_deg, scan.face_rotation_deg))
    heights = "[prism] lowered_mm and raised_mm"
    wanted = [
        (
            "translation",
            "mm",
            scan.origin_mm - half_mm,
            scan.origin_mm + half_mm,
            "[scan] origin_mm, step_mm, positions",
        ),
        ("rotation", "deg", turns_deg[0], turns_deg[1], "[scan] corner_rotation_deg and face_rotation_deg"),
        ("jacks", "mm", prism.lowered_mm, prism.raised_mm, heights),
    ]
    for camera in ("primary", "auxiliary"):
        wanted.append((camera, "s", scan.exposure_s, scan.exposure_s, "[scan] exposure_s"))
        wanted.append((camera, "db", scan.gain_db, scan.gain_db, "[scan] gain_db"))
    for name, unit, low, high, keys in wanted:
        limits = _limits(getattr(config.devices, name), unit)
        if limits and not limits[0] <= low <= high <= limits[1]:
            asked = f"{low:g}" if low == high else f"{low:g} to {high:g}"
            yield f"{keys}: ask for {asked} {unit}; [devices.{name}] allows {limits[0]:g} to {limits[1]:g}"


def _limits(device: DeviceConfig | None, unit: str) -> tuple[float, float] | None:
    """The range that a driver's options state in that unit; two stacked jacks add up."""
    options = _options(device)
    parts = {"s": ("exposure_limits_s",), "db": ("gain_limits_db",)}.get(unit, (f"limits_{unit}",))
    stacked = ("lower_limits_mm", "upper_limits_mm")
    own = ("limits",) if getattr(options, "unit", None) == unit else parts
    for names in (own, stacked) if unit == "mm" else (own,):
        if all(hasattr(options, name) for name in names):
            ranges = [_ends(getattr(options, name)) for name in names]
            return sum(low for low, _ in ranges), sum(high for _, high in ranges)
    return None


def _ends(interval: Any) -> tuple[float, float]:
    return (interval.low, interval.high) if isinstance(interval, Range) else interval


def _options(device: DeviceConfig | None) -> BaseModel | None:
    options = device.options if device else None
    return options.root if isinstance(options, RootModel) else options
