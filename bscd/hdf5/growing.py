"""A file while one program writes it: readable by others all the while, and ended with a state and a reason."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import h5py

from bscd.errors import BscdError
from bscd.hdf5.kind import ENTRY, RECORDING
from bscd.hdf5.nodes import dataset_at
from bscd.hdf5.opening import abandon, write_failure
from bscd.hdf5.states import FileState

#: Room that is left on the disk, enough to close the file.
RESERVE_BYTES = 8_000_000

#: With less room nothing is written any more: HDF5 crashes the process when it can not flush.
_LEAST_BYTES = 1_000_000


def utc_now() -> datetime:
    """The host's wall clock, UTC."""
    return datetime.now(UTC)


def utc_text(time: datetime) -> str:
    """A time as files keep it: ISO 8601, UTC, to the millisecond."""
    return time.astimezone(UTC).isoformat(timespec="milliseconds")


@contextmanager
def beginning(path: Path, file: h5py.File, doing: str, *, new: bool) -> Iterator[None]:
    """Let go of a file that could not be begun; a new one is removed."""
    try:
        yield
    except (OSError, RuntimeError) as err:
        abandon(file)
        if new:
            path.unlink(missing_ok=True)
        raise write_failure(path, doing, err) from err
    except BaseException:
        file.close()
        if new:
            path.unlink(missing_ok=True)
        raise


class GrowingFile:
    """An open file that grows; no group or dataset can be made any more, since SWMR allows none.

    ``reserve_bytes`` of the disk are left free. With ``sync`` each `flush` waits until the disk itself has it.
    """

    def __init__(
        self,
        path: Path,
        file: h5py.File,
        now: Callable[[], datetime],
        *,
        reserve_bytes: int = RESERVE_BYTES,
        sync: bool = False,
    ) -> None:
        self.path = path
        self.file = file
        self._now = now
        self._reserve_bytes = reserve_bytes
        self._sync = sync
        file.swmr_mode = True
        self._put(f"{RECORDING}/state", FileState.RECORDING.value)
        self._put(f"{RECORDING}/reason", "")
        self._put(f"{RECORDING}/sha256", "")
        file.flush()

    @property
    def is_open(self) -> bool:
        """Whether it has neither ended nor been given up."""
        return bool(self.file)

    def time_text(self) -> str:
        """Now, as the file keeps it."""
        return utc_text(self._now())

    def stamp(self) -> None:
        """Write the time of now as the end so far."""
        self._put(f"{ENTRY}/end_time", self.time_text())

    def flush(self) -> None:
        """Hand everything to the operating system, and where asked for see it to the disk."""
        self.file.flush()
        if self._sync:
            os.fsync(self._descriptor)

    def end(self, state: FileState, reason: str, sha256: str) -> None:
        """Write how it ended, see it to the disk and close it."""
        with self.writing("closing it"):
            self._put(f"{RECORDING}/sha256", sha256)
            self._put(f"{RECORDING}/reason", reason)
            self._put(f"{RECORDING}/state", state.value)
            self.file.flush()
            os.fsync(self._descriptor)
            self.file.close()

    @contextmanager
    def writing(self, doing: str) -> Iterator[None]:
        """Give the file up when writing fails: what was flushed can be read, nothing more can be written."""
        try:
            self._require_room()
            yield
        except (OSError, RuntimeError) as err:
            abandon(self.file)
            raise write_failure(self.path, doing, err) from err

    def check_space(self, needed_bytes: int) -> None:
        """Stop while the file can still be closed well: once HDF5 fails to write, it can not."""
        try:
            free_bytes = shutil.disk_usage(self.path.parent).free
            removed = not os.fstat(self._descriptor).st_nlink
        except OSError as err:
            raise BscdError(
                f"{self.path}: its folder can not be reached any more ({err.strerror}); look where the file went"
            ) from err
        if removed:
            raise BscdError(f"{self.path}: somebody deleted the file while it was recorded; record again")
        if free_bytes < needed_bytes + self._reserve_bytes:
            raise BscdError(
                f"{self.path}: the disk is full ({free_bytes / 1e6:.0f} MB left); the frames before are kept, "
                "make room to go on"
            )

    def _require_room(self) -> None:
        disk = os.fstatvfs(self._descriptor)
        if disk.f_bavail * disk.f_frsize < _LEAST_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    @property
    def _descriptor(self) -> int:
        return self.file.id.get_vfd_handle()

    def _put(self, name: str, value: str) -> None:
        dataset = dataset_at(self.file, name)
        size = dataset.dtype.itemsize
        dataset[()] = value.encode()[:size].decode("utf-8", "ignore").encode()
