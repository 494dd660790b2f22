"""Read a run file lazily: frames one at a time, their metadata as a table, means over repeated frames."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from bscd.acquisition.account_columns import read_account, read_time_base
from bscd.acquisition.checksum import frame_sha256, header_sha256, run_sha256
from bscd.acquisition.header import read_header
from bscd.acquisition.index import frame_index
from bscd.acquisition.layout import COLUMNS, INSTRUMENT, PRESSURE, RUN_FILE
from bscd.acquisition.means import FrameMean, mean_of_repeats, repeated_frames
from bscd.acquisition.names import AxisName, CameraName, PhaseName
from bscd.acquisition.pressure import interpolate_log_kpa
from bscd.acquisition.records import CameraMeta, FrameLoss, FrameRecord, RunEvent, RunHeader, TimeBase
from bscd.hdf5 import RECORDING, FileState, RecordedFile, dataset_at, group_at
from drivers.interfaces import FrameStatus

#: Columns of `RunFile.table`: where the frame is, then what is known of it.
_TABLE_DTYPE = np.dtype(
    [("camera", "U16"), ("row", "<i8")] + [(c.name, c.dtype.replace("S", "U")) for c in COLUMNS if c.name != "sha256"]
)


class RunFile(RecordedFile):
    """A run file, finished or still being written (then it shows what is there at each call).

    ``crashed`` says that no writer will come back. Raises `InputError` when the file is missing, is no run file, is cut
    off or damaged.
    """

    def __init__(self, path: str | os.PathLike[str], *, crashed: bool = False) -> None:
        super().__init__(path, RUN_FILE, crashed=crashed)

    def _read_header(self) -> None:
        self.header: RunHeader = read_header(self._file)
        self._detectors = [group_at(self._file, f"{INSTRUMENT}/{name}") for name in self.header.cameras]

    @property
    def uuid(self) -> str:
        """The run's uuid."""
        return self.header.uuid

    @property
    def title(self) -> str:
        """What the run is, in words."""
        return self.header.title

    @property
    def config_text(self) -> str:
        """The rig's configuration (TOML), empty when none was kept."""
        return self.header.config_text

    @property
    def recipe_text(self) -> str:
        """The recipe, empty when none was kept."""
        return self.header.recipe_text

    @property
    def cameras(self) -> Mapping[CameraName, CameraMeta]:
        """The cameras by name."""
        return self.header.cameras

    @property
    def events(self) -> tuple[RunEvent, ...]:
        """What happened during the run."""
        with self._reading("reading its events"):
            times, texts = self._fresh(f"{RECORDING}/event_time"), self._fresh(f"{RECORDING}/event_text")
            events: list[list[bytes]] = []
            for time, piece in zip(times, texts, strict=False):
                if b"\xff" in time + piece:  # never in text: the end of a file that was cut off
                    break
                if time or not events:
                    events.append([time, piece])
                else:
                    events[-1].append(piece)
            return tuple(RunEvent(e[0].decode(), b"".join(e[1:]).decode()) for e in events)

    @property
    def frames_acquired(self) -> int | None:
        """Exposures of the stream, lost ones among them; None where nobody counted, as in a scan or an import."""
        with self._reading("reading its account"):
            return read_account(group_at(self._file, RECORDING))[0]

    @property
    def losses(self) -> tuple[FrameLoss, ...]:
        """Exposures that are not in the file, and why."""
        with self._reading("reading its account"):
            return read_account(group_at(self._file, RECORDING))[1]

    @property
    def time_base(self) -> TimeBase | None:
        """How the camera's clock and the host's belong together; None where nobody looked."""
        with self._reading("reading its time base"):
            return read_time_base(group_at(self._file, RECORDING))

    def pressure_log(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The pressure log: times of the host's clock in ns ``(M,)`` and gauge pressures in kPa ``(M,)``."""
        if self.header.pressure is None:
            return np.zeros(0, np.int64), np.zeros(0)
        with self._reading("reading the pressure log"):
            times, values = self._fresh(f"{PRESSURE}/value_log/time"), self._fresh(f"{PRESSURE}/value_log/value")
            size = min(len(times), len(values))
            return times[:size].astype(np.int64), values[:size].astype(np.float64)

    def table(self, camera: CameraName | None = None, phase: PhaseName | None = None) -> NDArray[np.void]:
        """What is known of each frame, in the order recorded: a structured array with a field a column.

        Fields are those of `FrameRecord` (``target_position`` as a float, NaN for None), ``row`` (the frame's
        place among its camera's) and ``sequence_number`` (its place in the run). A frame that came without its
        pressure has the one interpolated in the pressure log, if there is a log.
        """
        with self._reading("reading the frames' metadata"):
            index = frame_index(self._detectors, self._rows if self._crashed else None)
            table = np.zeros(len(index), _TABLE_DTYPE)
            table["row"] = index[:, 1]
            for number, name in enumerate(self.cameras):
                mine = index[:, 0] == number
                table["camera"][mine] = name
                for column in COLUMNS:
                    if column.name in (_TABLE_DTYPE.names or ()):
                        values = self._rows(dataset_at(self._detectors[number], column.name))[index[mine, 1]]
                        table[column.name][mine] = np.char.decode(values) if values.dtype.kind == "S" else values
        logged = interpolate_log_kpa(table["host_time_ns"], *self.pressure_log())
        table["pressure_kpa"] = np.where(np.isnan(table["pressure_kpa"]), logged, table["pressure_kpa"])
        wanted = np.ones(len(table), bool)
        for field, value in (("camera", camera), ("phase", phase)):
            wanted &= (table[field] == value) if value is not None else True
        return table[wanted]

    def frames(
        self,
        camera: CameraName | None = None,
        phase: PhaseName | None = None,
        numbers: Collection[int] | None = None,
    ) -> Iterator[FrameRecord]:
        """The frames in the order recorded, each read when its turn comes; those of some sequence ``numbers`` only."""
        table = self.table(camera, phase)
        if numbers is not None:
            table = table[np.isin(table["sequence_number"], list(numbers))]
        for row in table:
            yield self._record(row, pressure_kpa=float(row["pressure_kpa"]))

    def groups(self, camera: CameraName | None = None, phase: PhaseName | None = None) -> Iterator[FrameMean]:
        """The mean of the repeated frames of each (camera, phase, target position), in the order recorded.

        Only frames whose status is ok count; a position without one is left out. Frames of a phase that have
        no target position form one group.
        """
        for rows in repeated_frames(self.table(camera, phase)):
            yield mean_of_repeats(self._record(row, pressure_kpa=float(row["pressure_kpa"])) for row in rows)

    def targets(self, axis: AxisName) -> NDArray[np.float64]:
        """Where an axis was sent, in its own readings, at each frame of the run ``(S,)``."""
        with self._reading(f"reading the targets of the {axis} axis"):
            return self._fresh(f"{INSTRUMENT}/{axis}/target_value").astype(np.float64)

    def recorded(self, row: np.void) -> tuple[FrameRecord, str]:
        """A frame of `table` as it was appended, with its pressure NaN where it came without, and its checksum."""
        where = f"reading frame {row['sequence_number']} ({row['camera']} camera, frame id {row['frame_id']})"
        with self._reading(where):
            detector = group_at(self._file, f"{INSTRUMENT}/{row['camera']}")
            kept = dataset_at(detector, "sha256")[row["row"]].decode()
            recorded_kpa = float(dataset_at(detector, "pressure_kpa")[row["row"]])
        return self._record(row, pressure_kpa=recorded_kpa), kept

    @property
    def begins_as_recorded(self) -> bool:
        """Whether its title, configuration, recipe and devices are what was recorded."""
        return header_sha256(self.header) == self._read_text(f"{RECORDING}/header_sha256")

    def verify(self, stop: Callable[[], bool] = lambda: False) -> str | None:
        """Recompute every checksum; the first difference in one sentence, None when all is as recorded.

        A run that has no checksum yet (recording, or its writer crashed) is compared frame by frame. ``stop`` is asked
        before each frame whether to give up, which counts as no difference found.
        """
        header = header_sha256(self.header)
        if not self.begins_as_recorded:
            return f"{self.path}: its title, configuration, recipe or devices are not what was recorded"
        digests: list[str] = []
        for row in self.table():
            if stop():
                return None
            record, kept = self.recorded(row)
            if frame_sha256(record) != kept:
                where = f"frame {row['sequence_number']} ({row['camera']} camera, frame id {row['frame_id']})"
                return f"{self.path}: {where} is not what was recorded"
            digests.append(kept)
        if (
            self._read_state() is not FileState.RECORDING
            and run_sha256(header, digests, *self.pressure_log()) != self.checksum
        ):
            return f"{self.path}: frames, or readings of the pressure, are missing or were exchanged"
        return None

    def _record(self, row: np.void, pressure_kpa: float) -> FrameRecord:
        where = f"reading frame {row['sequence_number']} of the {row['camera']} camera"
        with self._reading(where):
            data = dataset_at(self._file, f"{INSTRUMENT}/{row['camera']}/data")[row["row"]]
            position = float(row["target_position"])
            data.flags.writeable = False
            return FrameRecord(
                camera=row["camera"].item(),
                phase=row["phase"].item(),
                data=data,
                frame_id=int(row["frame_id"]),
                camera_time_ns=int(row["camera_time_ns"]),
                host_time_ns=int(row["host_time_ns"]),
                status=FrameStatus(str(row["status"])),
                target_position=None if math.isnan(position) else int(position),
                y_mm=float(row["y_mm"]),
                rotation_deg=float(row["rotation_deg"]),
                jack_mm=float(row["jack_mm"]),
                pressure_kpa=pressure_kpa,
                exposure_s=float(row["exposure_s"]),
                gain_db=float(row["gain_db"]),
                time_s=float(row["time_s"]),
            )
