"""Where everything stands in a run file, for the writer and the reader: NeXus names, columns, types.

NeXus base classes (https://manual.nexusformat.org/classes/base_classes/); ``docs/run-file.md`` explains it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.acquisition.names import AxisName, AxisUnit
from bscd.hdf5 import FileKind

#: What a run file is; a reader refuses a definition and a version that it does not know.
RUN_FILE = FileKind(
    name="run file",
    definition="bscd_run",
    version="1",
    source="a file of bscd import or a recording",
    restore="copy it again from where it was recorded",
    for_folder="make one of it with bscd import {path} RUN.h5",
    keep="raw data is never overwritten",
    after_crash="its frames can be read, by any program after bscd recover {path}; to go on record into a new file",
    when_cut_off="copy it again from where it was recorded, or keep the frames before with "
    "bscd recover {path} --out COPY.h5",
)

INSTRUMENT = "entry/instrument"
PRESSURE = "entry/instrument/pressure"

#: The column whose rows make frames valid: written last, so a crash never leaves half a frame.
COMMIT_COLUMN = "sequence_number"

#: Longest event in bytes of UTF-8; longer ones go on in the next row.
EVENT_BYTES = 256


@dataclass(frozen=True, slots=True)
class Column:
    """One value a frame in a detector group; ``fill`` stands where nothing was written."""

    name: str
    dtype: str
    unit: str
    description: str

    @property
    def fill(self) -> float | int | bytes:
        """NaN for numbers that may be unknown, -1 for counters, nothing for text."""
        kind = np.dtype(self.dtype).kind
        return np.nan if kind == "f" else -1 if kind == "i" else b""


COLUMNS: tuple[Column, ...] = (
    Column("frame_id", "<i8", "", "the camera's own count of exposures; a jump is a lost frame"),
    Column("camera_time_ns", "<i8", "ns", "the camera's clock at mid-exposure"),
    Column("host_time_ns", "<i8", "ns", "the host's clock on arrival"),
    Column("status", "S16", "", "ok, or why the frame is not to be trusted"),
    Column("phase", "S24", "", "the part of the procedure that the frame belongs to"),
    Column("target_position", "<f8", "", "k of POS.k, NaN where it does not apply"),
    Column("y_mm", "<f8", "mm", "displacement from POS.0, positive away from the camera"),
    Column("rotation_deg", "<f8", "deg", "reading of the rotation stage"),
    Column("jack_mm", "<f8", "mm", "reading of the lab jacks"),
    Column("pressure_kpa", "<f8", "kPa", "gauge pressure as known when the frame was recorded"),
    Column("exposure_s", "<f8", "s", "exposure time"),
    Column("gain_db", "<f8", "dB", "gain"),
    Column("time_s", "<f8", "s", "time since the start of the inflation"),
    Column("sha256", "S64", "", "checksum of the image and its metadata"),
    Column(COMMIT_COLUMN, "<i8", "", "place of the frame in the run, over all cameras, from 0"),
)

#: A frame's quantity that is the position of an axis.
AXIS_COLUMN: dict[AxisName, str] = {"translation": "y_mm", "rotation": "rotation_deg", "jack": "jack_mm"}
AXIS_UNIT: dict[AxisName, AxisUnit] = {"translation": "mm", "rotation": "deg", "jack": "mm"}
