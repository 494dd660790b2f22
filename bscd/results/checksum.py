"""Checksums of results: one a frame, one for what describes them, one over all.

They depend on what was measured and from what, not on the time, the file's own uuid or HDF5's bytes.
"""

from __future__ import annotations

import hashlib
import json
import math
import struct
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bscd.results.layout import QUANTITIES, RESULTS_FILE, Quantity
from bscd.results.records import FrameResult, Origin, ResultsHeader


def stored(values: Any, quantity: Quantity) -> NDArray[Any]:
    """A quantity as the file keeps it: its type, row by row, every NaN the same NaN."""
    kept = np.array(values, quantity.dtype, order="C")
    if kept.dtype.kind == "f":
        kept[np.isnan(kept)] = np.nan
    return kept


def frame_sha256(frame: FrameResult, arrays: Mapping[str, NDArray[Any]] | None = None) -> str:
    """SHA-256 (hex) of one frame: number, time and pressure, then the quantities in the order of the layout.

    ``arrays`` are the frame's quantities as `stored`, where they are at hand.
    """
    scalars = (math.nan if math.isnan(value) else value for value in (frame.time_s, frame.pressure_kpa))
    digest = hashlib.sha256(struct.pack("<q2d", frame.number, *scalars))
    for quantity in QUANTITIES:
        kept = stored(getattr(frame, quantity.name), quantity) if arrays is None else arrays[quantity.name]
        digest.update(kept.tobytes())
    return digest.hexdigest()


def header_sha256(header: ResultsHeader) -> str:
    """SHA-256 (hex) of what describes results as a whole, apart from names of files, uuid, time and program."""
    membrane = header.membrane
    content = {
        "title": header.title,
        "stereo": header.stereo,
        "run": _named(header.run),
        "calibration": _named(header.calibration),
        "reference_frames": list(header.reference_frames),
        "status_names": {str(code): name for code, name in header.status_names.items()},
        "parameters": dict(header.parameters),
        "membrane": None if membrane is None else [_numbers(membrane.origin_mm), _numbers(membrane.axes)],
        "points_px": hashlib.sha256(np.ascontiguousarray(header.points_px, "<f8").tobytes()).hexdigest(),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def results_sha256(header: str, frames: Iterable[str]) -> str:
    """SHA-256 (hex) of results from those of their header and of their frames."""
    digest = hashlib.sha256(f"{RESULTS_FILE.definition} {RESULTS_FILE.version}\n{header}\n".encode())
    for frame in frames:
        digest.update(frame.encode() + b"\n")
    return digest.hexdigest()


def _named(origin: Origin) -> list[str]:
    return [origin.uuid, origin.checksum]


def _numbers(values: Any) -> list[Any]:
    return np.asarray(values, np.float64).tolist()
