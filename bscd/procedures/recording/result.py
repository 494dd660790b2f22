"""What a recording comes to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Recording:
    """A finished recording.

    ``path`` is its file; ``frames`` are in it, ``incomplete_frames`` of them damaged on the way; ``lost_frames`` were
    exposed and never came. ``duration_s`` is of the rig's clock.
    """

    path: Path
    frames: int
    lost_frames: int
    incomplete_frames: int
    duration_s: float

    @property
    def dropped(self) -> int:
        """Exposures that can not be measured: lost or incomplete."""
        return self.lost_frames + self.incomplete_frames
