"""Driver name -> options model and factory; third parties add theirs through the ``bscd.drivers`` entry points.

An entry point's name is the driver's name (``kind.maker``, for example ``camera.aravis``) and its object a
`DriverEntry`. Only the composition root (daemon, cli) builds drivers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from typing import Any

from pydantic import BaseModel

from drivers.clock import Clock, HostClock
from drivers.operator import Operator

ENTRY_POINT_GROUP = "bscd.drivers"
KINDS = ("camera", "axis", "pressure", "world")


@dataclass(frozen=True)
class DriverContext:
    """What a factory gets beside its options."""

    name: str
    """The device's name in this rig, for messages: "primary", "rotation", ..."""
    clock: Clock = field(default_factory=HostClock)
    world: Any = None
    """The digital twin's world for simulated devices, else None."""
    operator: Operator | None = None
    """Who answers what a driver asks a person; None where nobody can be asked."""


@dataclass(frozen=True)
class DriverEntry:
    """One driver: what it drives, its validated options, how to build it."""

    kind: str
    """"camera", "axis", "pressure", or "world" for what simulated devices share."""
    options: type[BaseModel]
    factory: Callable[[Any, DriverContext], Any]
    summary: str = ""
    find: Callable[[], Sequence[str]] | None = None
    """Devices of this kind that can be seen now, a line each (what to configure it by, what it is). Raises
    `drivers.errors.DeviceError` where it can not look."""

    def build(self, options: Mapping[str, Any], context: DriverContext) -> Any:
        """The driver with these options; raises `pydantic.ValidationError` for ones that are wrong."""
        return self.factory(self.options.model_validate(dict(options)), context)


class UnknownDriverError(KeyError):
    """No driver of that name can be had; says which can, or why this one can not."""

    def __str__(self) -> str:
        """One sentence (a plain `KeyError` would show it in quotes)."""
        return str(self.args[0])


class Registry(Mapping[str, DriverEntry]):
    """The drivers known by name, built-in and installed.

    Parameters
    ----------
    entries : mapping of str to DriverEntry
        The drivers that can be had.
    broken : mapping of str to str
        Drivers that are installed and can not be loaded, with the reason.
    """

    def __init__(self, entries: Mapping[str, DriverEntry], broken: Mapping[str, str] | None = None) -> None:
        self._entries = dict(entries)
        self.broken = dict(broken or {})

    def __getitem__(self, name: str) -> DriverEntry:
        """The driver of that name; raises `UnknownDriverError`."""
        if name in self._entries:
            return self._entries[name]
        if name in self.broken:
            raise UnknownDriverError(f"driver {name!r} can not be loaded: {self.broken[name]}")
        raise UnknownDriverError(f"no driver {name!r}; known: {', '.join(sorted(self._entries)) or 'none'}")

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names."""
        return iter(self._entries)

    def __len__(self) -> int:
        """How many drivers there are."""
        return len(self._entries)


def installed_drivers() -> Registry:
    """Every driver that an installed package offers, bscd's own among them.

    One that can not be loaded (a missing library, another package's of the same name) does not keep the others
    from working; asking for it tells the reason.
    """
    entries: dict[str, DriverEntry] = {}
    broken: dict[str, str] = {}
    for point in entry_points(group=ENTRY_POINT_GROUP):
        try:
            entry = point.load()
        except Exception as error:  # whatever a third party's module raises when it is imported
            broken[point.name] = f"{point.value}: {error}"
            continue
        if not isinstance(entry, DriverEntry) or entry.kind not in KINDS:
            broken[point.name] = f"{point.value} is no DriverEntry of kind {', '.join(KINDS)}"
        elif entries.get(point.name) is entry:  # one package found twice
            continue
        elif point.name in entries or point.name in broken:
            broken[point.name] = "two packages offer a driver of that name; remove one"
            entries.pop(point.name, None)
        else:
            entries[point.name] = entry
    return Registry(entries, broken)
