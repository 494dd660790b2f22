"""Write the frames of one camera: images at once, their metadata by the block."""

from __future__ import annotations

import math

import h5py
import hdf5plugin  # noqa: F401  # HDF5 knows the filter of a compressed run by it
import numpy as np

from bscd.acquisition.layout import COLUMNS, COMMIT_COLUMN
from bscd.acquisition.records import CameraMeta, FrameRecord
from bscd.hdf5 import dataset_at


class DetectorWriter:
    """Grows one NXdetector group. A frame is valid once `mark` wrote its place in the run, and not before."""

    def __init__(self, group: h5py.Group, meta: CameraMeta, frames: int) -> None:
        self._meta = meta
        self._data = dataset_at(group, "data")
        self._plain = self._data.id.get_create_plist().get_nfilters() == 0
        self._columns = {column.name: dataset_at(group, column.name) for column in COLUMNS}
        self._rows: list[dict[str, object]] = []
        self._written = frames
        for dataset in (self._data, *self._columns.values()):
            if dataset.shape[0] != frames:  # what an interrupted recording left without its mark
                dataset.resize(frames, axis=0)

    def misfit(self, record: FrameRecord) -> str:
        """Why a frame can not be from this camera; empty when it can."""
        shape, dtype = (self._meta.height_px, self._meta.width_px), self._meta.dtype
        if record.data.shape == shape and record.data.dtype == dtype:
            return ""
        return f"it is {_size(record.data.shape)} {record.data.dtype}, the run was begun with {_size(shape)} {dtype}"

    def append(self, record: FrameRecord, sequence: int, sha256: str) -> None:
        """Write the image now and keep the metadata for `write_rows`."""
        row = self._written + len(self._rows)
        self._data.resize(row + 1, axis=0)
        if self._plain:  # a frame is a chunk: past HDF5's own buffers, which saves a copy
            self._data.id.write_direct_chunk((row, 0, 0), np.ascontiguousarray(record.data))
        else:
            self._data[row] = record.data
        self._rows.append(_row(record, sequence, sha256))

    def write_rows(self) -> None:
        """Write the metadata kept so far, all but the mark."""
        self._write([column.name for column in COLUMNS if column.name != COMMIT_COLUMN])

    def mark(self) -> None:
        """Make what was written valid; only after it has been flushed."""
        self._write([COMMIT_COLUMN])
        self._written += len(self._rows)
        self._rows = []

    def _write(self, names: list[str]) -> None:
        end = self._written + len(self._rows)
        if end == self._written:
            return
        for name in names:
            dataset = self._columns[name]
            dataset.resize(end, axis=0)
            dataset[self._written : end] = np.array([row[name] for row in self._rows], dataset.dtype)


def _row(record: FrameRecord, sequence: int, sha256: str) -> dict[str, object]:
    known = {column.name: getattr(record, column.name) for column in COLUMNS if hasattr(record, column.name)}
    position = math.nan if record.target_position is None else float(record.target_position)
    return known | {
        "target_position": position,
        "phase": record.phase.encode(),
        "status": record.status.value.encode(),
        "sha256": sha256.encode(),
        COMMIT_COLUMN: sequence,
    }


def _size(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, reversed(shape))) + " px"
