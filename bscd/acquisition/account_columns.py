"""The account of a stream in its run file: exposures, losses with their reasons, and the clocks' agreement."""

from __future__ import annotations

import math
from collections.abc import Sequence

import h5py
import numpy as np

from bscd.acquisition.layout import EVENT_BYTES
from bscd.acquisition.records import FrameLoss, TimeBase
from bscd.hdf5 import dataset_at, describe, make_column, make_number

_UNKNOWN = -1


def create_account(recording: h5py.Group) -> None:
    """Make room for the account in /entry/recording."""
    acquired = recording.create_dataset("frames_acquired", data=np.int64(_UNKNOWN))
    describe(acquired, "", "exposures of the stream, lost ones among them; -1 where nobody counted")
    make_column(recording, "lost_first", "<i8", _UNKNOWN, "", "number of the first exposure of a loss, from 0")
    make_column(recording, "lost_count", "<i8", 0, "", "exposures of a loss")
    make_column(recording, "lost_reason", h5py.string_dtype("utf-8", EVENT_BYTES), b"", "", "why they are not here")
    make_number(recording, "time_base_offset", math.nan, "ns")
    make_number(recording, "time_base_uncertainty", math.nan, "s")
    describe(dataset_at(recording, "time_base_offset"), "", "host's clock minus camera's, at mid-exposure")
    describe(dataset_at(recording, "time_base_uncertainty"), "", "bound of the error of that time")


def write_account(recording: h5py.Group, acquired: int, losses: Sequence[FrameLoss]) -> None:
    """Write the account of a stream that has ended; losses that were written before are replaced."""
    dataset_at(recording, "frames_acquired")[()] = acquired
    for name, values in (
        ("lost_first", [loss.first for loss in losses]),
        ("lost_count", [loss.count for loss in losses]),
        ("lost_reason", [loss.reason.encode()[:EVENT_BYTES].decode("utf-8", "ignore").encode() for loss in losses]),
    ):
        dataset = dataset_at(recording, name)
        dataset.resize(len(values), axis=0)
        dataset[:] = np.array(values, dataset.dtype)


def write_time_base(recording: h5py.Group, base: TimeBase) -> None:
    """Write how the clocks belong together."""
    dataset_at(recording, "time_base_offset")[()] = float(base.offset_ns)
    dataset_at(recording, "time_base_uncertainty")[()] = base.uncertainty_s


def read_account(recording: h5py.Group) -> tuple[int | None, tuple[FrameLoss, ...]]:
    """Exposures of the stream, None where nobody counted, and the losses among them."""
    columns = [dataset_at(recording, name) for name in ("lost_first", "lost_count", "lost_reason")]
    for dataset in (*columns, dataset_at(recording, "frames_acquired")):
        dataset.id.refresh()
    rows = zip(*(column[:] for column in columns), strict=False)
    acquired = int(dataset_at(recording, "frames_acquired")[()])
    losses = tuple(FrameLoss(int(first), int(count), reason.decode()) for first, count, reason in rows)
    return None if acquired == _UNKNOWN else acquired, losses


def read_time_base(recording: h5py.Group) -> TimeBase | None:
    """How the clocks belong together; None where nobody looked."""
    values = []
    for name in ("time_base_offset", "time_base_uncertainty"):
        dataset_at(recording, name).id.refresh()
        values.append(float(dataset_at(recording, name)[()]))
    return None if math.isnan(values[0]) else TimeBase(round(values[0]), values[1])
