"""Where drivers and procedures get their time from: the host's clock, or a virtual one that tests turn."""

from __future__ import annotations

import threading
import time
from typing import Protocol


class Clock(Protocol):
    """A monotonic clock that can also wait."""

    def now_s(self) -> float:
        """Seconds since an arbitrary start; never goes back."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Wait; a duration below zero waits not at all."""
        ...


class HostClock:
    """The host's monotonic clock."""

    def now_s(self) -> float:
        """Seconds of `time.monotonic`."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """Wait in real time."""
        if duration_s > 0:
            time.sleep(duration_s)


class VirtualClock:
    """A clock that jumps: `sleep` returns at once with the time advanced, so a scan of minutes takes none."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s
        self._lock = threading.Lock()

    def now_s(self) -> float:
        """Virtual seconds."""
        with self._lock:
            return self._now_s

    def sleep(self, duration_s: float) -> None:
        """Advance the clock by ``duration_s``."""
        if duration_s > 0:
            with self._lock:
                self._now_s += duration_s
