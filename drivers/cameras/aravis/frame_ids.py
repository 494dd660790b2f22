"""One count of frames out of a camera's frame ids, which wrap at 16 bits and may start anew."""

from __future__ import annotations

GIGE_IDS = 65_535
"""GigE Vision 1.x counts 1 to 65535, then 1 again: 0 is left out."""

_LARGEST_GAP = 1_000
"""A step between two acquisitions beyond this is taken for a fresh start of the camera's count."""


class FrameCount:
    """Counts from 0, by one an exposure; over a wrap, a restart and a reconnection.

    Parameters
    ----------
    wraps : bool
        Whether ids wrap at 16 bits, as those of GigE Vision 1.x do.
    """

    def __init__(self, *, wraps: bool) -> None:
        self._wraps = wraps
        self._last_raw: int | None = None
        self._untold = 0
        self._next = 0
        self._fresh = True

    @property
    def next_id(self) -> int:
        """The count of the next frame, if none is missing before it."""
        return self._next

    def begin(self) -> None:
        """A new acquisition: what is missing before its first frame was not lost by it."""
        self._fresh = True

    def forget(self, missing: int) -> None:
        """The camera starts anew, and about so many exposures were not made meanwhile."""
        self._last_raw = None
        self._next += missing

    def count(self, raw: int | None) -> tuple[int, int]:
        """The count of a frame with the camera's id ``raw``, and how many frames are missing before it.

        A frame whose id was lost on the way, None, is taken for the one after the last; what was missing before it is
        found by the next id that is told.
        """
        if raw is None:
            self._untold += 1
            self._next += 1
            return self._next - 1, 0
        step = self._step(raw)
        missing = 0 if self._fresh else step - 1
        frame_id = self._next + step - 1
        self._last_raw, self._untold, self._next, self._fresh = raw, 0, frame_id + 1, False
        return frame_id, missing

    def _step(self, raw: int) -> int:
        """From the last count to this one; the ids tell how far it is from the last frame that told its own."""
        if self._last_raw is None:
            return 1
        step = raw - self._last_raw
        if step <= 0 and self._wraps and self._last_raw <= GIGE_IDS:
            step += GIGE_IDS
        largest = _LARGEST_GAP if self._fresh else GIGE_IDS // 2
        return step - self._untold if self._untold < step <= largest else 1
