"""Live maps as events: thinned out, rounded to what they are worth, and plain enough for JSON."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bscd.procedures.live.messages import LiveCatchingUp, LiveDone, LiveEvent, LiveFrame

#: Points in an event.
_MOST = 200


def live_event(event: LiveEvent) -> dict[str, Any] | None:
    """An event's content, None for one that is told otherwise (warnings)."""
    if isinstance(event, LiveCatchingUp):
        return {"what": "catching up", "done": event.done, "total": event.total}
    if isinstance(event, LiveDone):
        return {"what": "done", "frames": event.frames, "caught_up": event.caught_up}
    if not isinstance(event, LiveFrame):
        return None
    some = slice(None, None, max(-(-len(event.index) // _MOST), 1))
    return {
        "what": "frame",
        "frame": event.number,
        "time_s": round(event.time_s, 6),
        "pressure_kpa": _number(event.pressure_kpa, 4),
        "points": event.points,
        "valid": event.valid,
        "w_max_mm": _number(event.w_max_mm, 5),
        "latency_s": round(event.latency_s, 4),
        "provisional": event.provisional,
        "index": event.index[some].tolist(),
        "points_px": _rows(event.points_px[some], 1),
        "uvw_mm": _rows(event.uvw_mm[some], 5),
        "sigma_mm": _rows(event.sigma_mm[some], 6),
        "zncc": _rows(event.zncc[some], 4),
        "status": event.status[some].tolist(),
    }


def _rows(values: NDArray[Any], digits: int) -> list[Any]:
    rounded = np.round(np.asarray(values, float), digits).astype(object)
    rounded[~np.isfinite(np.asarray(values, float))] = None
    return rounded.tolist()


def _number(value: float, digits: int) -> float | None:
    return round(value, digits) if math.isfinite(value) else None
