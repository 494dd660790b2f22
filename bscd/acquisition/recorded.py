"""What a run file holds already, for a writer that goes on with it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import h5py

from bscd.acquisition.header import read_header
from bscd.acquisition.index import frame_index
from bscd.acquisition.layout import INSTRUMENT, RUN_FILE
from bscd.acquisition.records import RunHeader, RunState
from bscd.errors import InputError
from bscd.hdf5 import RECORDING, damage_reported, dataset_at, group_at, text_at


@dataclass(frozen=True, slots=True)
class Recorded:
    """The header, the checksums of the frames in the order recorded, and how many frames each camera has."""

    header: RunHeader
    frames_sha256: list[str] = field(default_factory=list)
    frames_of: Counter[str] = field(default_factory=Counter)


def recorded_in(file: h5py.File, path: Path) -> Recorded:
    """What an interrupted run holds, or a recovered one: nobody writes it, or it could not have been opened.

    Raises `InputError` for one that is complete.
    """
    with damage_reported(path, RUN_FILE, "reading what was recorded"):
        state = text_at(file, f"{RECORDING}/state")
        header = read_header(file)
        names = list(header.cameras)
        detectors = [group_at(file, f"{INSTRUMENT}/{name}") for name in names]
        index = frame_index(detectors)
        digests = [dataset_at(detectors[d], "sha256")[row].decode() for d, row in index]
    if state == RunState.COMPLETE:
        raise InputError(f"{path} is complete; record into a new file")
    return Recorded(header, digests, Counter(names[d] for d, _ in index))
