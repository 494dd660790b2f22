"""Driver name -> options model and factory; third parties add theirs through the ``bscd.drivers`` entry points.

An entry point's name is the driver's name (``kind.maker``, for example ``camera.aravis``) and its object a
`DriverEntry`. Only the composition root (daemon, cli) builds drivers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from typing import Any

from pydantic import BaseModel

from drivers.clock import Clock, HostClock

ENTRY_POINT_GROUP = "bscd.drivers"


@dataclass(frozen=True)
class DriverContext:
    """What a factory gets beside its options."""

    name: str
    """The device's name in this rig, for messages: "primary", "rotation", ..."""
    clock: Clock = field(default_factory=HostClock)
    world: Any = None
    """The digital twin's world for simulated devices, else None."""


@dataclass(frozen=True)
class DriverEntry:
    """One driver: what it drives, its validated options, how to build it."""

    kind: str
    """"camera", "axis" or "pressure"."""
    options: type[BaseModel]
    factory: Callable[[Any, DriverContext], Any]
    summary: str = ""


class Registry(Mapping[str, DriverEntry]):
    """The drivers known by name, built-in and installed."""

    def __init__(self, entries: Mapping[str, DriverEntry]) -> None:
        self._entries = dict(entries)

    def __getitem__(self, name: str) -> DriverEntry:
        """The driver of that name; raises `KeyError` with the names there are."""
        try:
            return self._entries[name]
        except KeyError:
            raise KeyError(f"no driver {name!r}; known: {', '.join(sorted(self._entries))}") from None

    def __iter__(self):
        """Iterate over the names."""
        return iter(self._entries)

    def __len__(self) -> int:
        """How many drivers there are."""
        return len(self._entries)


def installed_drivers() -> Registry:
    """Every driver that an installed package offers, bscd's own among them."""
    return Registry({point.name: point.load() for point in entry_points(group=ENTRY_POINT_GROUP)})
