"""Read a results file lazily: frames one at a time, or one quantity over all of them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from bscd.arrays import FloatArray, IntArray
from bscd.hdf5 import RECORDING, FileState, RecordedFile, dataset_at
from bscd.results.checksum import frame_sha256, header_sha256, results_sha256
from bscd.results.header import read_header
from bscd.results.layout import COLUMNS, COMMIT_COLUMN, DATA, FRAME_SHA256, QUANTITIES, RESULTS_FILE
from bscd.results.records import FrameResult, ResultsHeader

#: Everything that `ResultsFile.array` reads.
_NAMES = tuple(quantity.name for quantity in QUANTITIES) + tuple(column[0] for column in COLUMNS)


class ResultsFile(RecordedFile):
    """A results file, finished or still being written (then it shows what is there at each call).

    Raises `InputError` when the file is missing, is no results file, is cut off or damaged.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        super().__init__(path, RESULTS_FILE)

    def _read_header(self) -> None:
        self.header: ResultsHeader = read_header(self._file)
        for quantity in QUANTITIES:
            self._expect(quantity.name, (len(self.header.points_px), *quantity.shape))
        for column in COLUMNS:
            self._expect(column[0], ())
        dataset_at(self._file, FRAME_SHA256)

    @property
    def points_px(self) -> FloatArray:
        """The requested points ``(N, 2)`` in the reference frame's left view."""
        return self.header.points_px

    @property
    def uuid(self) -> str:
        """The results' own uuid."""
        return self.header.uuid

    def __len__(self) -> int:
        """How many whole frames there are."""
        return len(self.frame_numbers())

    def frame_numbers(self) -> IntArray:
        """The numbers of the frames as recorded ``(T,)``, increasing."""
        with self._reading("reading the frames' numbers"):
            names = [*(f"{DATA}/{name}" for name in _NAMES), FRAME_SHA256]
            whole = min(self._refreshed(name).shape[0] for name in names)
            numbers = np.asarray(self._refreshed(f"{DATA}/{COMMIT_COLUMN}")[:whole], np.int64)
            unwritten = np.flatnonzero(numbers < 0)
            return numbers[: unwritten[0] if len(unwritten) else len(numbers)]

    def frame(self, index: int) -> FrameResult:
        """The frame with this place in the file, from 0; raises `IndexError` where there is none."""
        numbers = self.frame_numbers()
        if not 0 <= index < len(numbers):
            raise IndexError(f"{self.path} has {len(numbers)} frames, there is none at {index}")
        return self._frame(index, int(numbers[index]))

    def frames(self) -> Iterator[FrameResult]:
        """The frames in the order recorded, each read when its turn comes."""
        for index, number in enumerate(self.frame_numbers()):
            yield self._frame(index, int(number))

    def array(self, name: str) -> NDArray[Any]:
        """One quantity over all frames, ``(T, N, ...)``, or a value a frame, ``(T,)``.

        ``name`` is a field of `FrameResult` with ``frame_number`` for ``number``, or ``displacement_max_mm``,
        ``epipolar_median_px`` or ``valid_fraction``; another one is a `ValueError`.
        """
        if name not in _NAMES:
            raise ValueError(f"no quantity {name!r}; there are {', '.join(_NAMES)}")
        count = len(self)
        with self._reading(f"reading {name}"):
            return self._refreshed(f"{DATA}/{name}")[:count]

    def verify(self) -> str | None:
        """Recompute every checksum; the first difference in one sentence, None when all is as measured.

        Results that have no checksum yet (being written, or their writer crashed) are compared frame by frame.
        """
        header = header_sha256(self.header)
        if header != self._read_text(f"{RECORDING}/header_sha256"):
            return f"{self.path}: its title, points, parameters or origins are not what was measured"
        digests: list[str] = []
        for index, frame in enumerate(self.frames()):
            with self._reading(f"reading the checksum of frame {frame.number}"):
                kept = dataset_at(self._file, FRAME_SHA256)[index].decode()
            if frame_sha256(frame) != kept:
                return f"{self.path}: frame {frame.number} is not what was measured"
            digests.append(kept)
        if self.state is not FileState.RECORDING and results_sha256(header, digests) != self.checksum:
            return f"{self.path}: frames are missing or were exchanged"
        return None

    def _frame(self, index: int, number: int) -> FrameResult:
        with self._reading(f"reading frame {number}"):
            values = {name: self._refreshed(f"{DATA}/{name}")[index] for name in ("time_s", "pressure_kpa")}
            arrays = {quantity.name: self._refreshed(f"{DATA}/{quantity.name}")[index] for quantity in QUANTITIES}
        return FrameResult(number, float(values["time_s"]), float(values["pressure_kpa"]), **arrays)

    def _refreshed(self, name: str) -> h5py.Dataset:
        dataset = dataset_at(self._file, name)
        dataset.id.refresh()
        return dataset

    def _expect(self, name: str, shape: tuple[int, ...]) -> None:
        found = dataset_at(self._file, f"{DATA}/{name}").shape
        if found[1:] != shape:
            raise KeyError(f"{name} is {found}, not (T, {', '.join(map(str, shape))})")
