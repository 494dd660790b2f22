"""What the project's HDF5 files have in common: opened, written while they can be read, closed with a state."""

from bscd.hdf5.building import (
    FileIdentity,
    describe,
    make_column,
    make_entry,
    make_group,
    make_note,
    make_number,
    make_text,
)
from bscd.hdf5.growing import RESERVE_BYTES, GrowingFile, beginning, utc_now, utc_text
from bscd.hdf5.kind import ENTRY, RECORDING, FileKind
from bscd.hdf5.nodes import dataset_at, group_at, text_at
from bscd.hdf5.opening import (
    clear_crash,
    count_missing,
    create_file,
    damage_reported,
    is_left_open,
    open_to_continue,
    open_to_read,
    require_uncut,
)
from bscd.hdf5.reading import RecordedFile, read_identity
from bscd.hdf5.states import FileState

__all__ = [
    "ENTRY",
    "RECORDING",
    "RESERVE_BYTES",
    "FileIdentity",
    "FileKind",
    "FileState",
    "GrowingFile",
    "RecordedFile",
    "beginning",
    "clear_crash",
    "count_missing",
    "create_file",
    "damage_reported",
    "dataset_at",
    "describe",
    "group_at",
    "is_left_open",
    "make_column",
    "make_entry",
    "make_group",
    "make_note",
    "make_number",
    "make_text",
    "open_to_continue",
    "open_to_read",
    "read_identity",
    "require_uncut",
    "text_at",
    "utc_now",
    "utc_text",
]
