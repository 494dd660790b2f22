"""Checksums of a run: one a frame, one for what describes the run, one over all of it.

They depend on what was recorded and on nothing else (not on the time, the uuid or HDF5's own bytes), so the
same frames in the same order always give the same checksum.
"""

from __future__ import annotations

import hashlib
import json
import math
import struct
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bscd.acquisition.layout import RUN_FILE
from bscd.acquisition.records import FrameRecord, RunHeader

_QUANTITIES = ("y_mm", "rotation_deg", "jack_mm", "pressure_kpa", "exposure_s", "gain_db", "time_s")


def frame_sha256(record: FrameRecord) -> str:
    """SHA-256 (hex) of one frame: its metadata, then its pixels row by row, little-endian."""
    data = np.ascontiguousarray(record.data, record.data.dtype.newbyteorder("<"))
    names = [record.camera, record.phase, record.status.value, data.dtype.str, *map(str, data.shape)]
    position = math.nan if record.target_position is None else float(record.target_position)
    digest = hashlib.sha256("\n".join(names).encode() + b"\0")
    digest.update(struct.pack("<3q", record.frame_id, record.camera_time_ns, record.host_time_ns))
    for value in (position, *(getattr(record, name) for name in _QUANTITIES)):
        digest.update(struct.pack("<d", math.nan if math.isnan(value) else value))  # every NaN is the same NaN
    digest.update(data.data)
    return digest.hexdigest()


def header_sha256(header: RunHeader) -> str:
    """SHA-256 (hex) of what describes a run as a whole, apart from its uuid, start and program."""
    content = {
        "title": header.title,
        "config_text": header.config_text,
        "recipe_text": header.recipe_text,
        "cameras": {name: asdict(meta) for name, meta in header.cameras.items()},
        "axes": {name: asdict(meta) for name, meta in header.axes.items()},
        "pressure": None if header.pressure is None else asdict(header.pressure),
    }
    return hashlib.sha256(json.dumps(_plain(content), sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """Every number as a float, so that 50 and 50.0, which a file keeps alike, are alike."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return value if isinstance(value, str) or value is None else float(value)


def run_sha256(header: str, frames: Iterable[str], log_time_ns: NDArray[np.int64], log_kpa: NDArray[np.float64]) -> str:
    """SHA-256 (hex) of a run from those of its header and frames (in the order recorded) and its pressure log."""
    digest = hashlib.sha256(f"{RUN_FILE.definition} {RUN_FILE.version}\n{header}\n".encode())
    for frame in frames:
        digest.update(frame.encode() + b"\n")
    digest.update(np.ascontiguousarray(log_time_ns, "<i8").tobytes())
    digest.update(np.ascontiguousarray(log_kpa, "<f8").tobytes())
    return digest.hexdigest()
