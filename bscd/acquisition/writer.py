"""Write a run file: one writer, readable by others all the while, every frame checksummed."""

from __future__ import annotations

import contextlib
import os
import uuid
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from functools import partial
from pathlib import Path
from types import TracebackType

import h5py
import numpy as np

from bscd.acquisition.account_columns import write_account, write_time_base
from bscd.acquisition.checksum import frame_sha256, header_sha256, run_sha256
from bscd.acquisition.detector import DetectorWriter
from bscd.acquisition.layout import INSTRUMENT, RUN_FILE
from bscd.acquisition.names import CAMERAS, PHASES, AxisName, CameraName, Compression
from bscd.acquisition.recorded import Recorded, recorded_in
from bscd.acquisition.records import AxisMeta, CameraMeta, FrameLoss, FrameRecord, PressureMeta, RunHeader, TimeBase
from bscd.acquisition.run_columns import EventWriter, PositionerWriter, PressureWriter
from bscd.acquisition.skeleton import create_skeleton
from bscd.errors import BscdError, InputError
from bscd.hdf5 import (
    RECORDING,
    RESERVE_BYTES,
    FileState,
    GrowingFile,
    beginning,
    create_file,
    group_at,
    open_to_continue,
    utc_now,
    utc_text,
)
from bscd.version import __version__
from drivers.interfaces import PressureReading


class RunWriter:
    """A run file while it is recorded; a context manager.

    Leaving the block closes the file: complete, or, when an exception ends it, interrupted with the exception
    as the reason. Either way it can be read, and `reopen` goes on with an interrupted one.

    Parameters
    ----------
    path
        The new file; raises `InputError` when it exists.
    title
        What the run is, in words.
    cameras
        The cameras that will deliver frames; the first is what viewers show.
    config_text, recipe_text
        The rig's configuration (TOML) and the recipe, as they were written.
    axes, pressure
        What is known of the axes and of the pressure source; only those given are kept.
    program_version, run_uuid, start_time, now
        For copies and tests; by default this program's, a new one, now, and the host's clock.
    flush_every
        Frames after which everything is flushed: as many are lost at most when the program is killed.
    compression
        "bitshuffle-lz4" saves a fifth to a third of the disk and takes about 3 ms a frame of a processor.
    sync
        Whether each flush waits for the disk itself, so that a power failure loses no more than a kill.
    reserve_bytes
        Room that is left on the disk; a frame that would take of it ends the run.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        title: str,
        cameras: Mapping[CameraName, CameraMeta],
        config_text: str = "",
        recipe_text: str = "",
        axes: Mapping[AxisName, AxisMeta] | None = None,
        pressure: PressureMeta | None = None,
        program_version: str = __version__,
        run_uuid: str | None = None,
        start_time: str = "",
        flush_every: int = 1,
        compression: Compression = "none",
        sync: bool = False,
        reserve_bytes: int = RESERVE_BYTES,
        now: Callable[[], datetime] = utc_now,
    ) -> None:
        unknown = [name for name in cameras if name not in CAMERAS]
        if unknown or not cameras:
            raise ValueError(f"a run needs cameras of {CAMERAS}, not {list(cameras)}")
        header = RunHeader(
            title=title,
            cameras=dict(cameras),
            config_text=config_text,
            recipe_text=recipe_text,
            axes=dict(axes or {}),
            pressure=pressure,
            uuid=run_uuid or str(uuid.uuid4()),
            start_time=start_time or utc_text(now()),
            program_version=program_version,
        )
        where = Path(path)
        file = create_file(where, RUN_FILE)
        with beginning(where, file, "laying out the file", new=True):
            create_skeleton(file, header, compression)
            growing = partial(GrowingFile, now=now, reserve_bytes=reserve_bytes, sync=sync)
            self._begin(where, file, Recorded(header), flush_every, growing)

    @classmethod
    def reopen(
        cls, path: str | os.PathLike[str], *, flush_every: int = 1, now: Callable[[], datetime] = utc_now
    ) -> RunWriter:
        """Go on with an interrupted or a recovered run; its frames stay as they are, byte for byte.

        Raises `InputError` when the run is complete (raw data is never changed), being written, or when its writer was
        killed and nobody has recovered it.
        """
        where = Path(path)
        file = open_to_continue(where, RUN_FILE)
        with beginning(where, file, "opening it again", new=False):
            writer = cls.__new__(cls)
            writer._begin(where, file, recorded_in(file, where), flush_every, partial(GrowingFile, now=now))
            writer.event("recording goes on")
        return writer

    def _begin(
        self,
        path: Path,
        file: h5py.File,
        recorded: Recorded,
        flush_every: int,
        growing: Callable[[Path, h5py.File], GrowingFile],
    ) -> None:
        instrument, header = group_at(file, INSTRUMENT), recorded.header
        self.path = path
        self.header = header
        self._flush_every = flush_every
        self._digests = recorded.frames_sha256
        self._committed = frames = len(self._digests)
        self._detectors = {
            name: DetectorWriter(group_at(instrument, name), meta, recorded.frames_of[name])
            for name, meta in header.cameras.items()
        }
        self._positioners = {
            name: PositionerWriter(group_at(instrument, name), name, meta, frames) for name, meta in header.axes.items()
        }
        self._pressure = None if header.pressure is None else PressureWriter(file, frames)
        self._events = EventWriter(group_at(file, RECORDING))
        self._recording = group_at(file, RECORDING)
        self._growing = growing(path, file)
        self._left = False

    @property
    def uuid(self) -> str:
        """The run's uuid."""
        return self.header.uuid

    @property
    def is_open(self) -> bool:
        """Whether it can still be written: neither ended nor given up."""
        return not self._left and self._growing.is_open

    @property
    def frames_written(self) -> int:
        """Frames appended so far, over all cameras, earlier recordings of this run among them."""
        return len(self._digests)

    def append(self, record: FrameRecord) -> None:
        """Write one frame; raises `InputError` for one that does not fit the run, `BscdError` when writing fails."""
        self._check_open()
        if record.phase not in PHASES:
            raise InputError(f"{self.path}: no phase {record.phase!r}; there are {', '.join(PHASES)}")
        if record.camera not in self._detectors:
            known = ", ".join(self._detectors)
            raise InputError(f"{self.path}: a frame of the {record.camera} camera, the run was begun with {known}")
        detector = self._detectors[record.camera]
        if why := detector.misfit(record):
            raise InputError(f"{self.path}: frame {record.frame_id} of the {record.camera} camera does not fit, {why}")
        self.check_space(record.data.nbytes)
        digest = frame_sha256(record)
        with self._growing.writing(f"writing frame {len(self._digests)}"):
            detector.append(record, len(self._digests), digest)
        for positioner in self._positioners.values():
            positioner.append(record)
        if self._pressure is not None:
            self._pressure.append(record)
        self._digests.append(digest)
        if len(self._digests) - self._committed >= self._flush_every:
            self.flush()

    def check_space(self, needed_bytes: int) -> None:
        """Raise `BscdError` when so much does not fit the disk beside the reserve, or the file is gone."""
        self._growing.check_space(needed_bytes)

    def set_target(self, axis: AxisName, target: float) -> None:
        """Where an axis was sent, in its own readings; kept with the frames that follow."""
        self._positioners[axis].target = target

    def log_pressure(self, reading: PressureReading) -> None:
        """Add a reading to the pressure log; from it the pressure at each frame is interpolated."""
        if self._pressure is None:
            raise InputError(f"{self.path}: the run was begun without a pressure source")
        self._pressure.log(reading)

    def event(self, text: str, time: str = "") -> None:
        """Keep a remark with the time of now, or another (ISO 8601, UTC)."""
        self._check_open()
        with self._growing.writing("writing an event"):
            self._events.write(time or self._growing.time_text(), text)

    def time_text(self) -> str:
        """Now, as events keep it."""
        return self._growing.time_text()

    def account(self, acquired: int, losses: Sequence[FrameLoss]) -> None:
        """Keep how many exposures the stream had, and those that are not here."""
        self._check_open()
        with self._growing.writing("writing the account of the frames"):
            write_account(self._recording, acquired, losses)

    def state_time_base(self, base: TimeBase) -> None:
        """Keep how the camera's clock and the host's belong together."""
        self._check_open()
        with self._growing.writing("writing the time base"):
            write_time_base(self._recording, base)

    @property
    def unflushed(self) -> int:
        """Frames that a kill of this program would lose."""
        return len(self._digests) - self._committed

    def flush(self) -> None:
        """Hand everything to the operating system; the frames so far survive the end of this program."""
        self._check_open()
        with self._growing.writing("writing the frames' metadata"):
            for detector in self._detectors.values():
                detector.write_rows()
            for positioner in self._positioners.values():
                positioner.write()
            if self._pressure is not None:
                self._pressure.write()
            self._growing.stamp()
            self._growing.flush()  # before the marks, or a crash between could leave marked frames without content
            for detector in self._detectors.values():
                detector.mark()
            self._growing.file.flush()
        self._committed = len(self._digests)

    def close(self) -> None:
        """End the run as complete; does nothing when it has ended."""
        self._end(FileState.COMPLETE, "")

    def interrupt(self, reason: str) -> None:
        """End the run early, as incomplete, with the reason; `reopen` can go on. Does nothing when it has ended."""
        self._end(FileState.INTERRUPTED, reason)

    def leave(self) -> None:
        """Touch the file no more, as if this program had been killed: for a disk that answers no longer."""
        self._left = True

    def _end(self, state: FileState, reason: str) -> None:
        if not self.is_open:
            return
        self.flush()
        with self._growing.writing("closing it"):
            if self._pressure is not None:
                self._pressure.interpolate()
            log = self._pressure.readings() if self._pressure else (np.zeros(0, np.int64), np.zeros(0))
        self._growing.end(state, reason, run_sha256(header_sha256(self.header), self._digests, *log))

    def __enter__(self) -> RunWriter:
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
        if not self.is_open:
            raise BscdError(f"{self.path}: the run has ended; begin a new one or reopen it")
