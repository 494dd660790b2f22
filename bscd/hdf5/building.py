"""Make groups and datasets as NeXus names them, before the first frame, as SWMR needs it.

NeXus base classes: https://manual.nexusformat.org/classes/base_classes/
"""

from __future__ import annotations

from dataclasses import dataclass

import h5py

from bscd.hdf5.kind import FileKind
from bscd.hdf5.nodes import dataset_at
from bscd.hdf5.states import FileState

ROWS_PER_CHUNK = 256


@dataclass(frozen=True, slots=True)
class FileIdentity:
    """What every file says of itself; ``start_time`` is ISO 8601, UTC."""

    title: str
    uuid: str
    start_time: str
    program_version: str


def make_entry(file: h5py.File, kind: FileKind, identity: FileIdentity, header_sha256: str) -> h5py.Group:
    """The root's attributes, /entry with what identifies the file, and /entry/recording with its state."""
    file.attrs.update({"NX_class": "NXroot", "default": "entry", "creator": f"bscd {identity.program_version}"})
    entry = make_group(file, "entry", "NXentry")
    entry.attrs["default"] = "data"
    entry["title"] = identity.title
    entry["definition"] = kind.definition
    dataset_at(entry, "definition").attrs["version"] = kind.version
    entry["entry_identifier_uuid"] = identity.uuid
    entry["program_name"] = "bscd"
    dataset_at(entry, "program_name").attrs["version"] = identity.program_version
    entry["start_time"] = identity.start_time
    make_text(entry, "end_time", 32, identity.start_time)
    recording = make_group(entry, "recording", "NXcollection")
    make_text(recording, "header_sha256", 64, header_sha256)
    make_text(recording, "state", 16, FileState.RECORDING.value)
    make_text(recording, "reason", 512, "")
    make_text(recording, "sha256", 64, "")
    return entry


def make_group(parent: h5py.Group, name: str, nx_class: str) -> h5py.Group:
    """An empty group of a NeXus base class."""
    group = parent.create_group(name)
    group.attrs["NX_class"] = nx_class
    return group


def make_text(parent: h5py.Group, name: str, size: int, value: str) -> h5py.Dataset:
    """A text of fixed size, which can still be written in SWMR mode."""
    dataset = parent.create_dataset(name, shape=(), dtype=h5py.string_dtype("utf-8", size))
    dataset[()] = value.encode()
    return dataset


def make_number(parent: h5py.Group, name: str, value: float, unit: str) -> None:
    """A number with its unit."""
    parent[name] = float(value)
    dataset_at(parent, name).attrs["units"] = unit


def make_note(parent: h5py.Group, name: str, file_name: str, text: str) -> None:
    """A text as it was in a file."""
    note = make_group(parent, name, "NXnote")
    note["type"] = "text/plain"
    note["file_name"] = file_name
    note["data"] = text


def make_column(
    parent: h5py.Group, name: str, dtype: object, fill: object, unit: str = "", about: str = ""
) -> h5py.Dataset:
    """An empty dataset that grows by a value a row; ``fill`` stands where nothing was written."""
    dataset = parent.create_dataset(
        name, shape=(0,), maxshape=(None,), chunks=(ROWS_PER_CHUNK,), dtype=dtype, fillvalue=fill
    )
    describe(dataset, unit, about)
    return dataset


def describe(dataset: h5py.Dataset, unit: str, about: str) -> None:
    """Say a dataset's unit and what it is, where there is something to say."""
    if unit:
        dataset.attrs["units"] = unit
    if about:
        dataset.attrs["long_name"] = about
