"""Looks at the devices now and then, so that a status costs no word with a device; notices those that are lost."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from bscd.config import RigConfig
from bscd.daemon.bench import Bench
from bscd.daemon.documents import DeviceDocument
from bscd.daemon.events import EventLog
from drivers.errors import DeviceError
from drivers.interfaces import Axis, Camera, PressureSource

_JOIN_S = 10.0


class Poller:
    """Reads every device each ``period_s`` on a thread of its own, from `start` to `close`.

    ``on_lost`` is called after each look with the names of devices that are not connected, if any. ``between`` is
    called once a look, for what should happen as often (the live view of cameras that do nothing else).
    """

    def __init__(
        self,
        bench: Bench,
        events: EventLog,
        period_s: float,
        on_lost: Callable[[tuple[str, ...]], None],
        between: Callable[[], None] = lambda: None,
    ) -> None:
        self._bench, self._events, self._period_s = bench, events, period_s
        self._on_lost, self._between = on_lost, between
        self._ending, self._looking = threading.Event(), threading.Lock()
        self._seen: dict[str, DeviceDocument] = {
            name: DeviceDocument(name=name, kind=_kind(device), driver=_driver(bench.config, name), connected=False)
            for name, device in bench.rig.devices.items()
        }
        self._thread = threading.Thread(target=self._run, name="poller", daemon=True)
        self.turns = 0

    @property
    def documents(self) -> dict[str, DeviceDocument]:
        """The devices as they were last seen."""
        return dict(self._seen)

    @property
    def pressure_kpa(self) -> float | None:
        """The pressure as it was last seen."""
        there = self._seen.get("pressure")
        return None if there is None else there.reading

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self) -> None:
        """End, and join."""
        self._ending.set()
        if self._thread.ident is not None:
            self._thread.join(_JOIN_S)

    def look(self) -> None:
        """Look at every device now. One look at a time: what ``on_lost`` is told is never older than another look."""
        with self._looking:
            for name, device in self._bench.rig.devices.items():
                before, now = self._seen[name], self._look_at(name, device)
                self._seen[name] = now
                if _rounded(before) != _rounded(now):
                    self._events.publish("device", now.model_dump(mode="json"))
            lost = tuple(name for name, seen in self._seen.items() if not seen.connected)
            if lost:
                self._on_lost(lost)

    def _run(self) -> None:
        while not self._ending.wait(self._period_s):
            self.look()
            self._between()
            self.turns += 1

    def _look_at(self, name: str, device: Camera | Axis | PressureSource) -> DeviceDocument:
        common = {"name": name, "kind": _kind(device), "driver": _driver(self._bench.config, name)}
        known = self._seen[name]
        try:
            seen = _LOOKS[_kind(device)](device)
            if seen["connected"] and not known.identity:
                seen["identity"] = _identity(device)
        except DeviceError as error:
            seen = {"connected": False, "problem": str(error)}
        return DeviceDocument.model_validate(common | {"identity": known.identity} | seen)


def _camera(device: Any) -> dict[str, Any]:
    status = device.status()
    return {
        "connected": status.connected,
        "details": {
            "streaming": status.streaming,
            "exposure_s": status.exposure_s,
            "gain_db": status.gain_db,
            "delivered_frames": status.delivered_frames,
            "lost_frames": status.lost_frames,
        },
    }


def _axis(device: Any) -> dict[str, Any]:
    status = device.status()
    unit = device.info().unit if status.connected else ""
    return {
        "connected": status.connected,
        "reading": status.position if math.isfinite(status.position) else None,
        "unit": unit,
        "homed": status.homed,
        "moving": status.moving,
        "problem": status.fault,
        "details": {"target": status.target} if math.isfinite(status.target) else {},
    }


def _pressure(device: Any) -> dict[str, Any]:
    reading = device.read()
    seen: dict[str, Any] = {"connected": True, "reading": reading.pressure_kpa, "unit": "kPa"}
    with suppress(DeviceError):
        seen["details"] = {"set_point_kpa": device.set_point_kpa()}
    return seen


_LOOKS: dict[str, Callable[[Any], dict[str, Any]]] = {"camera": _camera, "axis": _axis, "pressure": _pressure}


def _identity(device: Any) -> str:
    info = device.info()
    parts = [info.vendor, info.model, info.serial and f"serial {info.serial}", info.firmware]
    return ", ".join(part for part in parts if part)


def _kind(device: object) -> Any:
    return "camera" if hasattr(device, "snap") else "axis" if hasattr(device, "move_to") else "pressure"


def _driver(config: RigConfig, name: str) -> str:
    return getattr(config.devices, name).driver


def _rounded(document: DeviceDocument) -> tuple[Any, ...]:
    """What makes a change worth telling: not the noise of a reading."""
    reading = None if document.reading is None else round(document.reading, 2)
    return document.connected, document.homed, document.moving, document.problem, reading
