"""Read what all files that grow have in common, finished or still being written."""

from __future__ import annotations

import os
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from bscd.hdf5.building import FileIdentity
from bscd.hdf5.kind import ENTRY, RECORDING, FileKind
from bscd.hdf5.nodes import dataset_at, readable_rows, text_at
from bscd.hdf5.opening import damage_reported, open_cleared, open_to_read
from bscd.hdf5.states import FileState

_RECOVERED = "its writer was killed; recovered"


def read_identity(file: h5py.File) -> FileIdentity:
    """What the file says of itself; `KeyError` where a part is missing."""
    return FileIdentity(
        title=text_at(file, f"{ENTRY}/title"),
        uuid=text_at(file, f"{ENTRY}/entry_identifier_uuid"),
        start_time=text_at(file, f"{ENTRY}/start_time"),
        program_version=str(dataset_at(file, f"{ENTRY}/program_name").attrs["version"]),
    )


class RecordedFile:
    """A file of a kind; while it is written it shows what is there at each call. A context manager.

    With ``crashed`` it is known that no writer will come back: damage is then told at once, where HDF5 otherwise waits
    for the writer to repair it, and columns of which a part can not be read end there. Raises `InputError` when the
    file is missing, is of no or another kind, is cut off (unless ``crashed``) or damaged.
    """

    def __init__(self, path: str | os.PathLike[str], kind: FileKind, *, crashed: bool = False) -> None:
        self.path = Path(path)
        self._kind = kind
        self._crashed = crashed
        with ExitStack() as opened:
            cleared = opened.enter_context(open_cleared(self.path, kind)) if crashed else None
            self._file = opened.enter_context(open_to_read(self.path, kind, cleared))
            self._read_state()
            with self._reading("reading its header"):
                self._read_header()
            self._opened = opened.pop_all()

    def _read_header(self) -> None:
        """Read what is fixed when the file is made; for the kinds to fill in."""

    @property
    def checksum(self) -> str:
        """SHA-256 over all that was written; empty while it is written or when its writer crashed."""
        return self._read_text(f"{RECORDING}/sha256")

    @property
    def state(self) -> FileState:
        """Whether it is recording (or its writer crashed), complete or interrupted (also: recovered from a crash)."""
        return FileState.INTERRUPTED if self._recovered else self._read_state()

    @property
    def complete(self) -> bool:
        """Whether it came to its end."""
        return self.state is FileState.COMPLETE

    @property
    def reason(self) -> str:
        """Why it was interrupted, else empty."""
        return _RECOVERED if self._recovered else self._read_text(f"{RECORDING}/reason")

    @property
    def end_time(self) -> str:
        """When the last frame was flushed or it ended (ISO 8601, UTC)."""
        return self._read_text(f"{ENTRY}/end_time")

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._opened.close()

    def __enter__(self) -> Self:
        """The file itself; it is open since it was made."""
        return self

    def __exit__(self, *ended: object) -> None:
        """Close the file."""
        self.close()

    def _reading(self, doing: str) -> AbstractContextManager[None]:
        """Turn HDF5's errors on reading into one sentence."""
        return damage_reported(self.path, self._kind, doing)

    def _fresh(self, name: str) -> NDArray[np.generic]:
        dataset = dataset_at(self._file, name)
        dataset.id.refresh()
        return self._rows(dataset)

    def _rows(self, dataset: h5py.Dataset) -> NDArray[Any]:
        return readable_rows(dataset) if self._crashed else dataset[:]

    def _read_text(self, name: str) -> str:
        with self._reading(f"reading {name}"):
            dataset_at(self._file, name).id.refresh()
            return text_at(self._file, name)

    @property
    def _recovered(self) -> bool:
        """Whether no writer has it open although it never ended: a crash, whose mark was cleared."""
        return not self._file.swmr_mode and self._read_state() is FileState.RECORDING

    def _read_state(self) -> FileState:
        with self._reading("reading its state"):
            return FileState(self._read_text(f"{RECORDING}/state"))
