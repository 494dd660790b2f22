"""Open run files, and say in one sentence why one can not be opened."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from bscd.acquisition.layout import DEFINITION, ENTRY, FORMAT_VERSION
from bscd.acquisition.nodes import dataset_at, text_at
from bscd.errors import BscdError, InputError

#: HDF5 1.10's format: the oldest that has SWMR, readable by every tool of today.
_LIBVER = ("v110", "v110")


def create_file(path: Path) -> h5py.File:
    """A new, empty HDF5 file; raises `InputError` rather than overwrite anything."""
    try:
        return h5py.File(path, "x", libver=_LIBVER)
    except FileExistsError as err:
        raise InputError(f"{path} exists already and raw data is never overwritten; choose another name") from err
    except FileNotFoundError as err:
        raise InputError(f"{path}: there is no folder {path.parent}; make it or choose another one") from err
    except OSError as err:
        raise InputError(f"{path} can not be made ({_reason(err)}); choose another place") from err


def open_to_continue(path: Path) -> h5py.File:
    """An existing run file, to be written on."""
    _check_is_file(path)
    try:
        file = h5py.File(path, "r+", libver=_LIBVER)
    except OSError as err:
        raise _explained(path, err) from err
    return _checked(file, path)


def open_to_read(path: Path) -> h5py.File:
    """An existing run file, finished, being written, or left by a writer that crashed."""
    _check_is_file(path)
    try:
        file = h5py.File(path, "r")
    except OSError as err:
        if "already open for write" not in str(err):
            raise _explained(path, err) from err
        try:
            file = h5py.File(path, "r", swmr=True)
        except OSError as second:
            raise _explained(path, second) from second
    return _checked(file, path)


@contextmanager
def damage_reported(path: Path, doing: str) -> Iterator[None]:
    """Turn HDF5's errors on reading into one sentence."""
    try:
        yield
    except (OSError, RuntimeError, KeyError, ValueError, UnicodeError) as err:
        raise InputError(
            f"{path} is damaged ({doing}: {_reason(err)}); copy it again from where it was recorded"
        ) from err


@contextmanager
def write_failure_reported(path: Path, doing: str) -> Iterator[None]:
    """Turn HDF5's errors on writing into one sentence."""
    try:
        yield
    except (OSError, RuntimeError) as err:
        raise BscdError(
            f"{path}: {doing} failed ({_reason(err)}); look whether the disk is full or gone. "
            "The frames before can be read"
        ) from err


def _check_is_file(path: Path) -> None:
    if path.is_dir():
        raise InputError(f"{path} is a folder, not a run file; make one of it with bscd import {path} RUN.h5")
    if not path.exists():
        raise InputError(f"{path} does not exist; check the name")


def _reason(err: Exception) -> str:
    """What HDF5 or the system said, on one line."""
    strerror = getattr(err, "strerror", None)
    said = str(strerror or err).replace("\n", " ").strip()
    inner = said[said.find("(") + 1 : said.rfind(")")] if said.endswith(")") else said
    return inner[:160] or type(err).__name__


def _explained(path: Path, err: OSError) -> InputError:
    said = str(err)
    if "signature not found" in said:
        return InputError(f"{path} is not an HDF5 file; give a run file that bscd recorded or imported")
    if "truncated" in said:
        return InputError(f"{path} is cut off, it is shorter than it was; copy it again from where it was recorded")
    if "already open for write" in said:
        return InputError(
            f"{path} is being written, or its writer crashed; its frames can be read, but to go on record "
            "the rest into a new file"
        )
    if isinstance(err, BlockingIOError) or "unable to lock" in said:
        return InputError(f"{path} is in use by another program; close it there first")
    if isinstance(err, PermissionError):
        return InputError(f"{path} may not be opened by this user; change its permissions")
    return InputError(f"{path} can not be read ({_reason(err)}); copy it again from where it was recorded")


def _checked(file: h5py.File, path: Path) -> h5py.File:
    """The file, if it is a run file of a version that is known here; else it is closed."""
    try:
        with damage_reported(path, "reading its definition"):
            known = f"{ENTRY}/definition" in file
            definition = text_at(file, f"{ENTRY}/definition") if known else ""
            version = str(dataset_at(file, f"{ENTRY}/definition").attrs.get("version", "")) if known else ""
        if definition != DEFINITION:
            kind = f"it is a {definition!r} file" if definition else "it names no definition"
            raise InputError(f"{path} is not a run file of bscd ({kind}); give a file of bscd import or a recording")
        if version != FORMAT_VERSION:
            raise InputError(
                f"{path} is a run file of version {version!r}, this program reads version {FORMAT_VERSION}; "
                "use the program that wrote it"
            )
    except BaseException:
        file.close()
        raise
    return file
