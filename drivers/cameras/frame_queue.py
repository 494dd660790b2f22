"""Frames between the thread that takes them from a camera and the one that reads them."""

from __future__ import annotations

import threading
import time
from collections import deque

from drivers.interfaces import Frame


class FrameQueue:
    """Holds so many frames, oldest first; further ones are lost and counted. Safe to use from any thread."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._frames: deque[Frame] = deque()
        self._change = threading.Condition()
        self._delivered = self._overrun = 0
        self._open = True
        self._failure: Exception | None = None

    def put(self, frame: Frame) -> None:
        """Add a frame; it is lost when there is no room."""
        with self._change:
            if len(self._frames) >= self._capacity:
                self._overrun += 1
            else:
                self._frames.append(frame)
                self._change.notify()

    def get(self, timeout_s: float) -> Frame | None:
        """The oldest frame; None when none came in time or the queue was closed. Raises what `fail` was given."""
        deadline_s = time.monotonic() + timeout_s
        with self._change:
            while self._open and not self._frames:
                if self._failure is not None:
                    raise self._failure
                left_s = deadline_s - time.monotonic()
                if left_s <= 0.0:
                    return None
                self._change.wait(left_s)
            if not self._open:
                return None
            self._delivered += 1
            return self._frames.popleft()

    def fail(self, failure: Exception | None) -> None:
        """Have readers get the frames that are there, then this error; None: let them wait again."""
        with self._change:
            self._failure = failure
            self._change.notify_all()

    def close(self) -> None:
        """Discard the frames and let readers go."""
        with self._change:
            self._open = False
            self._frames.clear()
            self._change.notify_all()

    @property
    def is_open(self) -> bool:
        """Whether it was not closed yet."""
        return self._open

    def counts(self) -> tuple[int, int]:
        """Frames delivered to readers, and frames lost for want of room."""
        with self._change:
            return self._delivered, self._overrun
