"""A frame count from time stamps, for cameras whose frames have no number."""

from __future__ import annotations


class InferredCount:
    """Counts frames by the time between them: what it calls missing is inferred, not told by the camera.

    A step of 1.5 periods or more means missing frames; a camera that is late by less, or that lengthens its period
    by itself, is not told from one that is in time.
    """

    def __init__(self) -> None:
        self._last_ns: int | None = None
        self._next = 0

    def restart(self) -> None:
        """The period changed, or the camera was away: infer nothing for the next frame."""
        self._last_ns = None

    def skip(self, missing: int) -> None:
        """So many frames were not made."""
        self._next += missing

    def count(self, time_ns: int, period_s: float) -> tuple[int, int]:
        """The count of a frame with this time stamp, and how many seem to be missing before it."""
        missing = 0
        if self._last_ns is not None:
            missing = max(round(1e-9 * (time_ns - self._last_ns) / period_s) - 1, 0)
        self._last_ns = time_ns
        frame_id = self._next + missing
        self._next = frame_id + 1
        return frame_id, missing
