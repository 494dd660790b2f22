"""What a recording comes to."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path


class Ending(StrEnum):
    """Why a recording ended that was neither stopped nor failed."""

    COMPLETED = "completed"
    """All that was planned."""
    BURST = "burst"
    """The pressure fell while it should not: the membrane burst, or leaks."""
    LIMIT = "pressure limit"
    """The pressure rose above its limit."""


@dataclass(frozen=True)
class Recording:
    """A finished recording.

    ``path`` is its file; ``frames`` are in it, ``incomplete_frames`` of them damaged on the way; ``lost_frames`` were
    exposed and are not in the file. ``duration_s`` is of the rig's clock. ``ending`` is why it ended, ``reason`` says
    it in words where it was not as planned. ``peak_fill`` is the most frames that ever waited for the disk.
    """

    path: Path
    frames: int
    lost_frames: int
    incomplete_frames: int
    duration_s: float
    ending: Ending = Ending.COMPLETED
    reason: str = ""
    peak_fill: int = 0

    @property
    def dropped(self) -> int:
        """Exposures that can not be measured: lost or incomplete."""
        return self.lost_frames + self.incomplete_frames
