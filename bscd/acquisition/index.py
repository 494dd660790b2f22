"""Which frames of a run file are valid, and in what order they were recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from bscd.acquisition.layout import COLUMNS, COMMIT_COLUMN
from bscd.hdf5 import dataset_at


def frame_index(
    detectors: Sequence[h5py.Group], rows: Callable[[h5py.Dataset], NDArray[Any]] | None = None
) -> NDArray[np.int64]:
    """Detector and row ``(N, 2)`` of every valid frame, in the order recorded.

    A frame is valid when its place in the run was written (that is written last) and all frames before it are
    valid too; so a recording that was cut off ends at its last whole frame. ``rows`` reads what can be read of a
    column, for a file of which parts are missing.
    """
    places = [_places(detector, rows) for detector in detectors]
    found = np.concatenate([np.empty((0, 3), np.int64), *(_numbered(d, place) for d, place in enumerate(places))])
    found = found[np.argsort(found[:, 0], kind="stable")]
    gaps = np.flatnonzero(found[:, 0] != np.arange(len(found)))
    return found[: gaps[0] if len(gaps) else len(found), 1:]


def _places(detector: h5py.Group, rows: Callable[[h5py.Dataset], NDArray[Any]] | None) -> NDArray[np.int64]:
    columns = [dataset_at(detector, name) for name in ("data", *(column.name for column in COLUMNS))]
    for dataset in columns:
        dataset.id.refresh()
    whole = min(dataset.shape[0] for dataset in columns)
    if rows is not None:
        whole = min(whole, *(len(rows(dataset)) for dataset in columns[1:]))
    places = np.asarray(dataset_at(detector, COMMIT_COLUMN)[:whole], np.int64)
    unwritten = np.flatnonzero(places < 0)
    return places[: unwritten[0] if len(unwritten) else len(places)]


def _numbered(detector: int, places: NDArray[np.int64]) -> NDArray[np.int64]:
    rows = np.arange(len(places))
    return np.stack([places, np.full(len(places), detector), rows], axis=-1)
