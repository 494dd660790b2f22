"""Write a results file frame by frame: readable by others all the while, every frame checksummed."""

from __future__ import annotations

import contextlib
import os
import uuid
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from bscd.errors import BscdError
from bscd.hdf5 import (
    RECORDING,
    FileState,
    GrowingFile,
    beginning,
    create_file,
    dataset_at,
    group_at,
    utc_now,
    utc_text,
)
from bscd.results.checksum import frame_sha256, header_sha256, results_sha256, stored
from bscd.results.layout import COLUMNS, COMMIT_COLUMN, DATA, FRAME_SHA256, MEASUREMENT, QUANTITIES, RESULTS_FILE
from bscd.results.records import FrameResult, ResultsHeader
from bscd.results.skeleton import check_header, create_skeleton


class ResultsWriter:
    """A results file while frames are measured; a context manager.

    Leaving the block closes the file: complete, or, when an exception ends it, interrupted with the exception as
    the reason. Either way its frames can be read. Memory does not grow with their number.

    Parameters
    ----------
    path
        The new file; raises `InputError` when it exists.
    header
        What describes the results; ``uuid`` and ``start_time`` are set where they are empty.
    flush_every
        Frames after which everything is flushed: as many are lost at most when the program is killed.
    now
        For tests; by default the host's clock.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        header: ResultsHeader,
        *,
        flush_every: int = 1,
        now: Callable[[], datetime] = utc_now,
    ) -> None:
        check_header(header)
        self.path = Path(path)
        self.header = replace(
            header, uuid=header.uuid or str(uuid.uuid4()), start_time=header.start_time or utc_text(now())
        )
        self._flush_every = flush_every
        self._numbers: list[int] = []
        self._digests: list[str] = []
        self._committed = 0
        file = create_file(self.path, RESULTS_FILE)
        with beginning(self.path, file, "laying out the file", new=True):
            create_skeleton(file, self.header)
            data = group_at(file, DATA)
            names = [quantity.name for quantity in QUANTITIES] + [column[0] for column in COLUMNS]
            self._datasets = {name: dataset_at(data, name) for name in names}
            self._sha256 = dataset_at(file, FRAME_SHA256)
            self._growing = GrowingFile(self.path, file, now)

    @property
    def uuid(self) -> str:
        """The results' own uuid."""
        return self.header.uuid

    @property
    def frames_written(self) -> int:
        """Frames appended so far."""
        return len(self._digests)

    def append(self, frame: FrameResult) -> None:
        """Write one frame.

        Raises
        ------
        ValueError
            The frame does not fit the header, or its number does not follow the last one's.
        BscdError
            Writing failed, the disk is full, or the file has ended.
        """
        self._check_open()
        arrays = self._arrays(frame)
        self._growing.check_space(sum(array.nbytes for array in arrays.values()))
        digest = frame_sha256(frame, arrays)
        row = len(self._digests)
        with self._growing.writing(f"writing frame {frame.number}"):
            for name, values in {**arrays, **_summary(frame)}.items():
                _put(self._datasets[name], row, values)
            _put(self._sha256, row, digest.encode())
        self._digests.append(digest)
        self._numbers.append(frame.number)
        if len(self._digests) - self._committed >= self._flush_every:
            self.flush()

    def flush(self) -> None:
        """Hand everything to the operating system; the frames so far survive the end of this program."""
        self._check_open()
        with self._growing.writing("writing the frames' numbers"):
            self._growing.stamp()
            self._growing.file.flush()  # before the marks, or a crash between could leave marked frames without content
            for row in range(self._committed, len(self._numbers)):
                _put(self._datasets[COMMIT_COLUMN], row, self._numbers[row])
            self._growing.file.flush()
        self._committed = len(self._numbers)

    def name_run(self, uuid: str, checksum: str) -> None:
        """Name the run that was measured while it was recorded, once it is complete."""
        self._check_open()
        self.header = replace(self.header, run=replace(self.header.run, uuid=uuid, checksum=checksum))
        file = self._growing.file
        with self._growing.writing("naming its run"):
            dataset_at(file, f"{MEASUREMENT}/run/uuid")[()] = uuid.encode()
            dataset_at(file, f"{MEASUREMENT}/run/sha256")[()] = checksum.encode()
            dataset_at(file, f"{RECORDING}/header_sha256")[()] = header_sha256(self.header).encode()

    def close(self) -> None:
        """End the results as complete; does nothing when they have ended."""
        self._end(FileState.COMPLETE, "")

    def interrupt(self, reason: str) -> None:
        """End them early, with the reason; does nothing when they have ended."""
        self._end(FileState.INTERRUPTED, reason)

    def _end(self, state: FileState, reason: str) -> None:
        if self._growing.is_open:
            self.flush()
            self._growing.end(state, reason, results_sha256(header_sha256(self.header), self._digests))

    def _arrays(self, frame: FrameResult) -> Mapping[str, NDArray[Any]]:
        """The frame's quantities as stored; `ValueError` where it does not fit."""
        if self._numbers and frame.number <= self._numbers[-1]:
            raise ValueError(f"frame {frame.number} comes after frame {self._numbers[-1]}")
        arrays = {quantity.name: stored(getattr(frame, quantity.name), quantity) for quantity in QUANTITIES}
        for quantity in QUANTITIES:
            wanted = (len(self.header.points_px), *quantity.shape)
            if arrays[quantity.name].shape != wanted:
                raise ValueError(
                    f"frame {frame.number}: {quantity.name} is {arrays[quantity.name].shape}, not {wanted}"
                )
        unnamed = set(np.unique(arrays["status"]).tolist()) - set(self.header.status_names)
        if unnamed:
            raise ValueError(f"frame {frame.number}: status codes {sorted(unnamed)} have no name")
        return arrays

    def __enter__(self) -> ResultsWriter:
        """The writer itself; the file is open since it was made."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close, complete or interrupted."""
        if error is None:
            self.close()
            return
        with contextlib.suppress(BscdError):  # the first error is the one to report
            self.interrupt(str(error) or type(error).__name__)

    def _check_open(self) -> None:
        if not self._growing.is_open:
            raise BscdError(f"{self.path}: the results have ended; measure into a new file")


def _put(dataset: h5py.Dataset, row: int, values: Any) -> None:
    dataset.resize(row + 1, axis=0)
    dataset[row] = values


def _summary(frame: FrameResult) -> dict[str, float]:
    """A frame's values of its own and over its points."""
    moved_mm = np.linalg.norm(np.asarray(frame.displacement_mm, np.float64)[frame.valid], axis=1)
    moved_mm = moved_mm[~np.isnan(moved_mm)]
    beside_px = frame.epipolar_px[~np.isnan(frame.epipolar_px)]
    return {
        "time_s": frame.time_s,
        "pressure_kpa": frame.pressure_kpa,
        "displacement_max_mm": float(moved_mm.max()) if len(moved_mm) else np.nan,
        "epipolar_median_px": float(np.median(beside_px)) if len(beside_px) else np.nan,
        "valid_fraction": float(np.mean(frame.valid)),
    }
