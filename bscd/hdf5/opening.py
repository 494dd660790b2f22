"""Open files, and say in one sentence why one can not be opened."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py

from bscd.errors import BscdError, InputError
from bscd.hdf5.kind import ENTRY, FileKind
from bscd.hdf5.nodes import dataset_at, text_at
from bscd.hdf5.superblock import (
    FLAGS,
    OPEN_FOR_WRITE,
    SIGNATURE,
    VERSION,
    ClearedFile,
    clear_open_mark,
    missing_bytes,
    require_whole,
)

#: HDF5 1.10's format: the oldest that has SWMR, readable by every tool of today.
_LIBVER = ("v110", "v110")

#: Chunks that a dataset of a file that is written keeps in memory: all columns that wait for the rest of theirs. HDF5's
#: own 8 MB a dataset fill up for minutes, with chunks that nobody reads again.
_CACHE_BYTES = 524_288

_SYSTEM_SAID = re.compile(r"error message = '([^']+)'")


def create_file(path: Path, kind: FileKind) -> h5py.File:
    """A new, empty HDF5 file; raises `InputError` rather than overwrite anything."""
    try:
        return h5py.File(path, "x", libver=_LIBVER, rdcc_nbytes=_CACHE_BYTES)
    except FileExistsError as err:
        raise InputError(f"{path} exists already and {kind.keep}; choose another name") from err
    except FileNotFoundError as err:
        raise InputError(f"{path}: there is no folder {path.parent}; make it or choose another one") from err
    except OSError as err:
        raise InputError(f"{path} can not be made ({_reason(err)}); choose another place") from err


def open_to_continue(path: Path, kind: FileKind) -> h5py.File:
    """An existing file, to be written on."""
    _superblock(path, kind)
    try:
        file = h5py.File(path, "r+", libver=_LIBVER, rdcc_nbytes=_CACHE_BYTES)
    except OSError as err:
        raise _explained(path, kind, err) from err
    return _checked(file, path, kind)


def open_cleared(path: Path, kind: FileKind) -> ClearedFile:
    """What a killed writer left, without its mark, for `open_to_read`; to be closed after the file."""
    _superblock(path, kind)
    with damage_reported(path, kind, "reading its first bytes"):
        return ClearedFile(path)


def open_to_read(path: Path, kind: FileKind, cleared: ClearedFile | None = None) -> h5py.File:
    """An existing file, finished, being written, or left by a writer that crashed (then also from `open_cleared`)."""
    left_open = _superblock(path, kind)[FLAGS] & OPEN_FOR_WRITE
    try:
        file = h5py.File(cleared, "r") if cleared else h5py.File(path, "r", swmr=bool(left_open))
    except OSError as err:
        raise _explained(path, kind, err) from err
    return _checked(file, path, kind)


def abandon(file: h5py.File) -> None:
    """Let go of a file whose writing failed, as a crash would leave it.

    HDF5 2.0 crashes the process when it closes a file that it could not write, so it is made to believe that
    the rest goes to the disk.
    """
    nowhere = os.memfd_create("bscd-abandoned")
    try:
        os.dup2(nowhere, file.id.get_vfd_handle())
    finally:
        os.close(nowhere)
    with suppress(OSError, RuntimeError):
        file.close()


def is_left_open(path: Path, kind: FileKind) -> bool:
    """Whether a file is being written or its writer was killed. Raises `InputError` for what is no HDF5 file."""
    return bool(_superblock(path, kind)[FLAGS] & OPEN_FOR_WRITE)


def clear_crash(path: Path, kind: FileKind) -> bool:
    """Clear the mark that a killed writer left on a file; False when there is none. No data is touched.

    Raises `InputError` for a file of another shape and one that may not be written. The caller has made sure that
    nobody writes it.
    """
    _superblock(path, kind)
    try:
        return clear_open_mark(path)
    except ValueError as err:
        raise InputError(f"{path} is damaged ({err}); {kind.restore}") from err
    except OSError as err:
        raise InputError(f"{path} can not be changed ({_reason(err)}); recover it into a copy with --out") from err


def require_uncut(path: Path, kind: FileKind) -> None:
    """Raise `InputError` when the end of a file is missing; nothing is to be changed in it then."""
    if lost := count_missing(path, kind):
        raise InputError(f"{path} is cut off, {lost} bytes of its end are missing; {_when_cut_off(path, kind)}")


def count_missing(path: Path, kind: FileKind) -> int:
    """How many bytes of a file's end are missing. Raises `InputError` for a file of another shape."""
    _superblock(path, kind)
    with damage_reported(path, kind, "reading its first bytes"):
        return missing_bytes(path)


@contextmanager
def damage_reported(path: Path, kind: FileKind, doing: str) -> Iterator[None]:
    """Turn HDF5's errors on reading into one sentence."""
    try:
        yield
    except (OSError, RuntimeError, KeyError, ValueError, UnicodeError) as err:
        raise InputError(f"{path} is damaged ({doing}: {_reason(err)}); {kind.restore}") from err


def write_failure(path: Path, doing: str, err: Exception) -> BscdError:
    """HDF5's error on writing in one sentence."""
    return BscdError(
        f"{path}: {doing} failed ({_reason(err)}); look whether the disk is full or gone. The frames before can be read"
    )


def _superblock(path: Path, kind: FileKind) -> bytes:
    """The head of the file's superblock; raises `InputError` for what is no HDF5 file."""
    if path.is_dir():
        raise InputError(f"{path} is a folder, not a {kind.name}; {kind.for_folder.format(path=path)}")
    try:
        with path.open("rb") as file:
            head = file.read(64)
    except FileNotFoundError as err:
        raise InputError(f"{path} does not exist; check the name") from err
    except OSError as err:
        raise _explained(path, kind, err) from err
    if not head.startswith(SIGNATURE) or len(head) <= FLAGS:
        raise InputError(f"{path} is not an HDF5 file; give {kind.source}")
    if head[VERSION] >= 3:
        with damage_reported(path, kind, "reading its first bytes"):
            require_whole(head)
    # before version 3 the byte means something else
    return head if head[VERSION] >= 3 else head[:FLAGS] + b"\0"


def _reason(err: Exception) -> str:
    """What HDF5 or the system said, on one line."""
    strerror = getattr(err, "strerror", None)
    said = str(strerror or err).replace("\n", " ").strip()
    if system := _SYSTEM_SAID.search(said):
        return system[1]
    inner = said[said.find("(") + 1 : said.rfind(")")] if said.endswith(")") else said
    return inner[:160] or type(err).__name__


def _explained(path: Path, kind: FileKind, err: OSError) -> InputError:
    said = str(err)
    if "truncated" in said:
        return InputError(f"{path} is cut off, it is shorter than it was; {_when_cut_off(path, kind)}")
    if "already open for write" in said:
        return InputError(f"{path} is being written, or its writer crashed; {kind.after_crash.format(path=path)}")
    if isinstance(err, BlockingIOError) or "unable to lock" in said:
        return InputError(f"{path} is in use by another program; close it there first")
    if isinstance(err, PermissionError):
        return InputError(f"{path} may not be opened by this user; change its permissions")
    return InputError(f"{path} can not be read ({_reason(err)}); {kind.restore}")


def _when_cut_off(path: Path, kind: FileKind) -> str:
    return kind.when_cut_off.format(path=path) or kind.restore


def _checked(file: h5py.File, path: Path, kind: FileKind) -> h5py.File:
    """The file, if it is one of the kind and of a version that is known here; else it is closed."""
    try:
        with damage_reported(path, kind, "reading its definition"):
            known = f"{ENTRY}/definition" in file
            definition = text_at(file, f"{ENTRY}/definition") if known else ""
            version = str(dataset_at(file, f"{ENTRY}/definition").attrs.get("version", "")) if known else ""
        if definition != kind.definition:
            found = f"it is a {definition!r} file" if definition else "it names no definition"
            raise InputError(f"{path} is not a {kind.name} of bscd ({found}); give {kind.source}")
        if version != kind.version:
            raise InputError(
                f"{path} is a {kind.name} of version {version!r}, this program reads version {kind.version}; "
                "use the program that wrote it"
            )
    except BaseException:
        file.close()
        raise
    return file
