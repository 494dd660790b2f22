"""Restore what a killed writer left of a run: in its place, by clearing the mark of its writer, or into a copy."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bscd.acquisition.checksum import frame_sha256
from bscd.acquisition.layout import RUN_FILE
from bscd.acquisition.names import AxisName
from bscd.acquisition.reader import RunFile
from bscd.acquisition.records import FrameRecord
from bscd.acquisition.writer import RunWriter
from bscd.errors import InputError
from bscd.hdf5 import clear_crash, count_missing, is_left_open, require_uncut
from drivers.interfaces import PressureReading


@dataclass(frozen=True)
class Recovery:
    """What came of a recovery.

    ``path`` is the file that can be used now, ``frames`` are in it. ``changed`` is False for a run that needed none.
    ``damage`` is the first difference to what was recorded, empty when there is none.
    """

    path: Path
    frames: int
    changed: bool
    damage: str


def is_unfinished(path: str | os.PathLike[str]) -> bool:
    """Whether a run is being written, or its writer was killed and nobody has recovered it.

    Raises `InputError` for what is no HDF5 file.
    """
    return is_left_open(Path(path), RUN_FILE)


def recover_in_place(path: str | os.PathLike[str], *, verify: bool = True) -> Recovery:
    """Make a run whose writer was killed a file that any program opens; no byte of its data is written.

    Only the mark of the writer is cleared. The run counts as interrupted from then on, and keeps every frame that was
    flushed. Without ``verify``, which reads all of it, its damage is not looked for.

    Raises `InputError` for a file that is being written, is no run file, may not be changed or misses its end.
    """
    where = Path(path)
    with RunFile(where, crashed=True):  # whether it is a run file at all
        pass
    if writer := _writer_of(where):
        raise InputError(f"{where} is being written by process {writer}; stop the recording there first")
    require_uncut(where, RUN_FILE)
    changed = clear_crash(where, RUN_FILE)
    with RunFile(where) as run:
        return Recovery(where, len(run.table()), changed, (run.verify() or "") if verify else "")


def recover_into(path: str | os.PathLike[str], copy: str | os.PathLike[str]) -> Recovery:
    """Write the whole frames of a killed, cut off or damaged run into a new file, and close that as interrupted.

    It has the run's uuid, and ends at the first frame that can not be read or is not as recorded. The run itself is
    only read. Raises `InputError` when ``copy`` exists, the run can not be opened at all or, cut off, has no frame.
    """
    damage: list[str] = []
    missing = count_missing(Path(path), RUN_FILE)
    with RunFile(path, crashed=True) as run:
        header = run.header
        if missing and not (run.begins_as_recorded and next(_whole_frames(run, []), None)):
            raise InputError(f"{path} is cut off before the end of its first frame; {RUN_FILE.restore}")
        with RunWriter(
            copy,
            title=header.title,
            cameras=header.cameras,
            config_text=header.config_text,
            recipe_text=header.recipe_text,
            axes=header.axes,
            pressure=header.pressure,
            program_version=header.program_version,
            run_uuid=header.uuid,
            start_time=header.start_time,
            flush_every=16,
        ) as writer:
            targets: dict[AxisName, NDArray[np.float64]] = {name: run.targets(name) for name in header.axes}
            for number, record in enumerate(_whole_frames(run, damage)):
                for name, values in targets.items():
                    writer.set_target(name, float(values[number]) if number < len(values) else math.nan)
                writer.append(record)
            for time_ns, kpa in zip(*run.pressure_log(), strict=True):
                if time_ns < 0 or (missing and math.isnan(kpa)):
                    break
                writer.log_pressure(PressureReading(float(kpa), int(time_ns)))
            for event in run.events:
                writer.event(event.text, event.time)
            if run.frames_acquired is not None and not missing:
                writer.account(run.frames_acquired, run.losses)
            if run.time_base is not None:
                writer.state_time_base(run.time_base)
            frames = writer.frames_written
            how = "it was cut off" if missing else "its writer was killed"
            writer.interrupt(run.reason or f"{how}; recovered into a copy")
    if missing:
        damage = [f"{path}: {missing} bytes of its end are missing"]
    return Recovery(Path(copy), frames, True, "".join(damage))


def _whole_frames(run: RunFile, damage: list[str]) -> Iterator[FrameRecord]:
    """The frames up to the first that is damaged, as they were appended."""
    for row in run.table():
        try:
            record, kept = run.recorded(row)
        except InputError as err:
            damage.append(str(err))
            return
        if frame_sha256(record) != kept:
            damage.append(f"{run.path}: frame {row['sequence_number']} is not what was recorded")
            return
        yield record


def _writer_of(path: Path) -> int | None:
    """A process that has the file open to write; None when there is none that this user may see."""
    there = path.stat()
    for process in Path("/proc").iterdir():
        if not process.name.isdigit():
            continue
        with suppress(OSError):  # it ended meanwhile, or is another user's
            for descriptor in (process / "fd").iterdir():
                with suppress(OSError):
                    seen = descriptor.stat()
                    if (seen.st_dev, seen.st_ino) == (there.st_dev, there.st_ino) and _writes(process, descriptor.name):
                        return int(process.name)
    return None


def _writes(process: Path, descriptor: str) -> bool:
    for line in (process / "fdinfo" / descriptor).read_text().splitlines():
        if line.startswith("flags:"):
            return bool(int(line.split()[1], 8) & (os.O_WRONLY | os.O_RDWR))
    return False
