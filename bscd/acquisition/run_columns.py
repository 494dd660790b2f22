"""Write what grows with the run as a whole: axes and pressure at each frame, the pressure log, events."""

from __future__ import annotations

import math

import h5py
import numpy as np
from numpy.typing import NDArray

from bscd.acquisition.layout import AXIS_COLUMN, EVENT_BYTES, PRESSURE
from bscd.acquisition.names import AxisName
from bscd.acquisition.pressure import interpolate_log_kpa
from bscd.acquisition.records import AxisMeta, FrameRecord
from bscd.hdf5 import dataset_at
from drivers.interfaces import PressureReading


def _extend(dataset: h5py.Dataset, values: list[float] | list[int]) -> None:
    start = dataset.shape[0]
    dataset.resize(start + len(values), axis=0)
    dataset[start:] = np.array(values, dataset.dtype)


class PositionerWriter:
    """An axis's reading and target at each frame; ``target`` is that of the frames to come."""

    def __init__(self, group: h5py.Group, name: AxisName, meta: AxisMeta, frames: int) -> None:
        self._value, self._target = dataset_at(group, "value"), dataset_at(group, "target_value")
        self._column = AXIS_COLUMN[name]
        self._origin = meta.origin
        self._values: list[float] = []
        self._targets: list[float] = []
        self.target = math.nan
        for dataset in (self._value, self._target):
            dataset.resize(frames, axis=0)

    def append(self, record: FrameRecord) -> None:
        """Keep the frame's reading (what it recorded, from the axis's own zero) for `write`."""
        self._values.append(getattr(record, self._column) + self._origin)
        self._targets.append(self.target)

    def write(self) -> None:
        """Write what was kept."""
        _extend(self._value, self._values)
        _extend(self._target, self._targets)
        self._values, self._targets = [], []


class PressureWriter:
    """The pressure log, and the pressure at each frame."""

    def __init__(self, file: h5py.File, frames: int) -> None:
        self._value = dataset_at(file, f"{PRESSURE}/value")
        self._log_time = dataset_at(file, f"{PRESSURE}/value_log/time")
        self._log_kpa = dataset_at(file, f"{PRESSURE}/value_log/value")
        self._value.resize(frames, axis=0)
        self._frame_times: list[int] = []
        self._frames_kpa: list[float] = []
        self._times: list[int] = []
        self._readings_kpa: list[float] = []
        self._first = frames

    def log(self, reading: PressureReading) -> None:
        """Keep a reading for `write`."""
        self._times.append(reading.host_time_ns)
        self._readings_kpa.append(reading.pressure_kpa)

    def append(self, record: FrameRecord) -> None:
        """Keep the pressure that a frame came with, and its time for `interpolate`."""
        self._frame_times.append(record.host_time_ns)
        self._frames_kpa.append(record.pressure_kpa)

    def write(self) -> None:
        """Write the log and the frames' own pressures."""
        _extend(self._log_time, self._times)
        _extend(self._log_kpa, self._readings_kpa)
        self._times, self._readings_kpa = [], []
        _extend(self._value, self._frames_kpa[self._value.shape[0] - self._first :])

    def readings(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The log as written: times of the host's clock in ns, and kPa."""
        return self._log_time[:], self._log_kpa[:]

    def interpolate(self) -> None:
        """Where a frame came without its pressure, take it from the log."""
        kpa = np.array(self._frames_kpa, np.float64)
        logged = interpolate_log_kpa(np.array(self._frame_times, np.int64), *self.readings())
        self._value[self._first :] = np.where(np.isnan(kpa), logged, kpa)


class EventWriter:
    """Remarks with their times."""

    def __init__(self, group: h5py.Group) -> None:
        self._time, self._text = dataset_at(group, "event_time"), dataset_at(group, "event_text")

    def write(self, time: str, text: str) -> None:
        """Write one remark; a long one takes several rows, of which only the first has its time."""
        rows = _pieces(text) or [b""]
        start = self._text.shape[0]
        for dataset, values in ((self._text, rows), (self._time, [time.encode(), *[b""] * (len(rows) - 1)])):
            dataset.resize(start + len(rows), axis=0)
            dataset[start:] = np.array(values, dataset.dtype)
        self._text.flush()


def _pieces(text: str) -> list[bytes]:
    """The text in UTF-8, in pieces that fit a row and never split a character."""
    pieces: list[bytes] = []
    rest = text.replace("\0", " ").encode("utf-8", "replace")
    while rest:
        piece = rest[:EVENT_BYTES].decode("utf-8", "ignore").encode()
        pieces.append(piece)
        rest = rest[len(piece) :]
    return pieces
