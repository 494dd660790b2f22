"""Whether a recording goes on: what the watchdog is told of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bscd.acquisition.names import RECORDER

if TYPE_CHECKING:
    from bscd.acquisition.stream import FrameRing


class RecordingWatch:
    """A follower of recordings that takes no frames; see `bscd.acquisition.stream.follower.Follower`."""

    name = "watchdog"

    def __init__(self) -> None:
        self._ring: FrameRing | None = None
        self._well = 0

    def begin(self, ring: FrameRing) -> None:
        """A recording begins."""
        self._ring = ring

    def end(self) -> None:
        """It has ended."""
        self._ring = None

    @property
    def frames(self) -> int:
        """Frames that have come in the recording that goes on."""
        ring = self._ring
        return 0 if ring is None else ring.counts[0]

    @property
    def streaming(self) -> bool:
        """Whether frames come that must not be missed: from the first one to the end."""
        return self.frames > 0

    def progress(self, turns: int) -> int:
        """Grows with ``turns`` while no frame waits for the disk, else with the frames that the recorder takes."""
        ring = self._ring
        counts = None if ring is None else ring.counts_of(RECORDER)
        if counts is None or not counts.waiting:
            self._well = turns
        return self._well + (0 if counts is None else counts.taken)
