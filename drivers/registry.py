"""Driver name -> options model and factory; third parties add theirs through the ``bscd.drivers`` entry points.

An entry point's name is the driver's name (``kind.maker``, for example ``camera.aravis``) and its object a
`DriverEntry`. Only the composition root (daemon, cli) builds drivers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint, entry_points
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
    """The drivers known by name, built-in and installed; what is installed is imported when it is asked for.

    Parameters
    ----------
    entries : mapping of str to DriverEntry
        Drivers that can be had.
    points : iterable of EntryPoint
        Drivers that packages offer. One that can not be loaded (a missing library, another package's of the same name)
        does not keep the others from working; asking for it tells the reason.
    """

    def __init__(self, entries: Mapping[str, DriverEntry], points: Iterable[EntryPoint] = ()) -> None:
        self._entries = dict(entries)
        self._broken: dict[str, str] = {}
        self._points: dict[str, list[EntryPoint]] = {}
        for point in points:
            self._points.setdefault(point.name, []).append(point)

    @property
    def broken(self) -> dict[str, str]:
        """Drivers that are installed and can not be loaded, with the reason."""
        self._load_all()
        return dict(self._broken)

    def __getitem__(self, name: str) -> DriverEntry:
        """The driver of that name; raises `UnknownDriverError`."""
        self._load(name)
        if name in self._entries:
            return self._entries[name]
        if name in self._broken:
            raise UnknownDriverError(f"driver {name!r} can not be loaded: {self._broken[name]}")
        raise UnknownDriverError(f"no driver {name!r}; known: {', '.join(sorted(self)) or 'none'}")

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of those that can be had."""
        self._load_all()
        return iter(self._entries)

    def __len__(self) -> int:
        """How many drivers can be had."""
        self._load_all()
        return len(self._entries)

    def _load_all(self) -> None:
        for name in list(self._points):
            self._load(name)

    def _load(self, name: str) -> None:
        for point in self._points.pop(name, ()):
            try:
                entry = point.load()
            except Exception as error:  # whatever a third party's module raises when it is imported
                self._broken[name] = f"{point.value}: {error}"
                continue
            if not isinstance(entry, DriverEntry) or entry.kind not in KINDS:
                self._broken[name] = f"{point.value} is no DriverEntry of kind {', '.join(KINDS)}"
            elif self._entries.get(name) is entry:  # one package found twice
                continue
            elif name in self._entries or name in self._broken:
                self._broken[name] = "two packages offer a driver of that name; remove one"
                self._entries.pop(name, None)
            else:
                self._entries[name] = entry


def installed_drivers() -> Registry:
    """Every driver that an installed package offers, bscd's own among them."""
    return Registry({}, entry_points(group=ENTRY_POINT_GROUP))
