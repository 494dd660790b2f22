"""A consumer's side of the ring: frames in order, how many may wait for it, and what it did not get."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from bscd.acquisition.records import FrameRecord
from bscd.shared_frames import SharedFrame


class Keep(StrEnum):
    """What a consumer gets when it falls behind."""

    ALL = "all"
    """Every frame that found a buffer, in order; what waits takes up the ring, so only the recorder asks for this."""
    FIRST = "first"
    """In order, as far as there is room among its own; the rest it catches up later, from the file."""
    NEWEST = "newest"
    """The latest frame; an older one that still waits is dropped for it."""


class FrameLease:
    """A frame in the ring, the consumer's until `release`; a context manager.

    ``record`` is what is known of the frame, its ``data`` ``(height, width)`` a read-only view on the ring.
    ``handle`` tells another process where the image is; release the lease when that process is done.
    """

    def __init__(self, number: int, record: FrameRecord, handle: SharedFrame, release: Callable[[], None]) -> None:
        self.number = number
        self.record = record
        self.handle = handle
        self._release: Callable[[], None] | None = release

    def release(self) -> None:
        """Give the buffer back; the view is not to be read any more. May be called twice."""
        release, self._release = self._release, None
        if release is not None:
            release()

    def give_back(self) -> int:
        """Release it and return its number."""
        self.release()
        return self.number

    def __enter__(self) -> FrameLease:
        """The lease itself."""
        return self

    def __exit__(self, *ended: object) -> None:
        """Give the buffer back."""
        self.release()


@dataclass(frozen=True, slots=True)
class ConsumerCounts:
    """Frames that a consumer was offered, took, and did not get; ``waiting`` are not taken yet."""

    offered: int
    taken: int
    left_out: int
    waiting: int


class Subscription:
    """What one consumer gets of a ring; made by `FrameRing.subscribe`.

    One thread takes; `take` waits with a time-out and gives None when nothing came, `ended` says whether more will.
    """

    def __init__(self, name: str, keep: Keep, depth: int, changed: threading.Condition) -> None:
        self.name = name
        self.keep = keep
        self.depth = depth
        self._changed = changed
        self._waiting: deque[FrameLease] = deque()
        self._held = self._offered = self._taken = 0
        self._left_out: list[int] = []
        self._left_out_count = 0
        self._closed = False

    @property
    def ended(self) -> bool:
        """Whether no frame waits and none will come."""
        with self._changed:
            return self._closed and not self._waiting

    @property
    def left_out(self) -> tuple[int, ...]:
        """Numbers of the frames that it did not get, in order, to be caught up from the file (`Keep.FIRST` alone)."""
        with self._changed:
            return tuple(self._left_out)

    def counts(self) -> ConsumerCounts:
        """What it was offered and what became of it."""
        with self._changed:
            return ConsumerCounts(self._offered, self._taken, self._left_out_count, len(self._waiting))

    def take(self, timeout_s: float) -> FrameLease | None:
        """The next frame, to be released; None when none came in ``timeout_s`` of real time, or the ring ended."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closed, timeout_s)
            if not self._waiting:
                return None
            self._taken += 1
            return self._waiting.popleft()

    def close(self) -> None:
        """Take no more; frames that wait are given back. Does nothing when closed."""
        with self._changed:
            self._closed = True
            while self._waiting:
                self._leave_out(self._waiting.popleft().give_back())

    def offer(self, number: int, lease: Callable[[], FrameLease]) -> None:
        """The ring's call for each frame, its lock held: put it in line as far as there is room, and count."""
        if self._closed:
            return
        self._offered += 1
        if self.keep is Keep.NEWEST:
            while self._waiting:
                self._leave_out(self._waiting.popleft().give_back())
        if self.keep is Keep.ALL or self._held < self.depth:
            self._held += 1
            self._waiting.append(lease())
        else:
            self._leave_out(number)

    def given_back(self) -> None:
        """The ring's call when a lease was released, its lock held."""
        self._held -= 1

    def end(self) -> None:
        """The ring's call when no more frames will come, its lock held."""
        self._closed = True

    def _leave_out(self, number: int) -> None:
        self._left_out_count += 1
        if self.keep is Keep.FIRST:
            self._left_out.append(number)
