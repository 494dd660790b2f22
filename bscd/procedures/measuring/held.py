"""Images that workers may still ask for, lent once and given back as soon as no view needs them."""

from __future__ import annotations

import threading
from collections.abc import Iterable

from bscd.dic.pool import Pool
from bscd.dic.tracker_state import REFERENCE, TrackerState
from bscd.procedures.measuring.chunks import LentFrame
from bscd.procedures.measuring.views import FrameImages


class HeldImages:
    """The reference, and frames from 0 in the order in which they were added."""

    def __init__(self, pool: Pool, reference: FrameImages, states: Iterable[TrackerState]) -> None:
        self._pool = pool
        self._lock = threading.Lock()
        self._states = list(states)
        self._next = min(state.tracked for state in self._states)
        self._lent: dict[int, LentFrame] = {REFERENCE: self._lend(reference)}

    def __len__(self) -> int:
        """How many are held."""
        return len(self._lent)

    def add(self, images: FrameImages, number: int | None = None) -> int:
        """Hold the next frame's images, or an earlier one's that a state names; returns its number."""
        lent = self._lend(images)
        with self._lock:
            given = self._next if number is None else number
            self._next += number is None
            self._lent[given] = lent
        return given

    def frames(self, numbers: Iterable[int]) -> dict[int, LentFrame]:
        """Those of some numbers."""
        with self._lock:
            return {number: self._lent[number] for number in numbers}

    def reached(self, view: int, state: TrackerState) -> None:
        """A view's state is another now: what no view needs any more is given back."""
        with self._lock:
            self._states[view] = state
            needed = frozenset().union(*(each.images for each in self._states))
            oldest = min(each.tracked for each in self._states)
            gone = [number for number in self._lent if number < oldest and number not in needed]
            released = [self._lent.pop(number) for number in gone]
        for frame in released:
            _release(frame)

    def close(self) -> None:
        """Give everything back."""
        with self._lock:
            released = list(self._lent.values())
            self._lent.clear()
        for frame in released:
            _release(frame)

    def _lend(self, images: FrameImages) -> LentFrame:
        return tuple(self._pool.lend(image) for image in images)


def _release(frame: LentFrame) -> None:
    for image in frame:
        image.release()
