"""What a recipe gets while it runs: the bench, the data folder, and ways to say where it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bscd.daemon.bench import Bench
from bscd.daemon.documents import LiveDocument
from bscd.daemon.files import DataFolder, FileKind
from bscd.daemon.prompts import Prompts
from bscd.daemon.running.control import JobControl
from bscd.daemon.running.recording_watch import RecordingWatch
from bscd.procedures import Progress
from bscd.procedures.live.messages import LiveEvent

#: By the name of a campaign's step: what it made, by kind.
Made = Mapping[str, Mapping[str, str]]


@dataclass(frozen=True)
class Reporting:
    """Where a recipe says what happens: ``progress`` with its unit, ``warn`` in a sentence, ``live`` each live map."""

    progress: Callable[[Progress, str], None]
    warn: Callable[[str], None]
    live: Callable[[LiveEvent, LiveDocument | None], None]


@dataclass
class Work:
    """A recipe that runs, alone or as a campaign's step. ``name`` is that of what it makes.

    ``first_step`` is where to go on with what it has begun before (None: where that ended). ``outputs`` and
    ``figures`` are filled by it.
    """

    name: str
    bench: Bench
    files: DataFolder
    prompts: Prompts
    control: JobControl
    reporting: Reporting
    reserve_bytes: int
    watch: RecordingWatch
    earlier: Made = field(default_factory=dict)
    first_step: int | None = None
    outputs: dict[str, str] = field(default_factory=dict)
    figures: dict[str, Any] = field(default_factory=dict)

    def given(self, kind: FileKind, name: str) -> Path:
        """The file that a recipe names: what an earlier step of that name made, or one in the data folder."""
        return self.files.path(kind, self.earlier.get(name, {}).get(kind, name))

    def making(self, kind: FileKind) -> Path:
        """Where this makes its file of a kind; kept as its output. What an earlier attempt made stays as it is."""
        name, attempt = self.name, 2
        while self.files.has(kind, name):
            name, attempt = f"{self.name}-{attempt}", attempt + 1
        path = self.files.new(kind, name)
        self.outputs[kind] = name
        return path

    def progress(self, unit: str) -> Callable[[Progress], None]:
        """A procedure's callback."""
        return lambda now: self.reporting.progress(now, unit)


def scan_defaults(config: Any) -> dict[str, Any]:
    """What a scan takes from [scan] where its recipe is silent."""
    names = (
        "positions",
        "step_mm",
        "frames_per_position",
        "poses",
        "corner_rotation_deg",
        "face_rotation_deg",
        "settle_s",
        "exposure_s",
        "gain_db",
    )
    return {name: getattr(config.scan, name) for name in names}
