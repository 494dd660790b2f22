"""Home the axes: let every axis find its reference position, the biprism's jacks first."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bscd.procedures.progress import require_going
from bscd.procedures.rig import Rig


@dataclass(frozen=True)
class Homed:
    """What homing did with one axis: whether it had to move, and its reading afterwards (axis's unit)."""

    moved: bool
    position: float
    unit: str


def home(
    rig: Rig,
    *,
    again: bool = False,
    progress: Callable[[str], None] | None = None,
    stop: threading.Event | None = None,
) -> Mapping[str, Homed]:
    """Home every axis that does not know where it is (``again``: every axis), one after the other.

    Whatever ends it, no axis is left moving. Raises the `drivers.errors.DeviceError` of the axis that failed,
    `bscd.procedures.ProcedureStoppedError` when ``stop`` is set between two axes.
    """
    done: dict[str, Homed] = {}
    try:
        for role, axis in rig.axes.items():
            require_going(stop, f"homing: before the {role}")
            info, status = axis.info(), axis.status()
            needed = info.can_home and (again or not status.homed)
            if needed:
                if progress is not None:
                    progress(f"homing the {role}")
                axis.home()
            done[role] = Homed(needed, axis.status().position, info.unit)
    finally:
        rig.stop_axes()
    return done
