"""The newest frame of a stream, for whoever looks."""

from __future__ import annotations

import threading
from dataclasses import replace

from bscd.acquisition.records import FrameRecord
from bscd.acquisition.stream.ring import FrameRing
from bscd.acquisition.stream.subscription import ConsumerCounts, Keep


class LiveView:
    """Keeps the newest frame of a ring; frames that nobody looked at are dropped and counted."""

    def __init__(self, ring: FrameRing) -> None:
        self._subscription = ring.subscribe("live view", Keep.NEWEST, depth=2)  # one waits while one is copied
        self._lock = threading.Lock()
        self._last: FrameRecord | None = None

    def latest(self, timeout_s: float = 0.0) -> FrameRecord | None:
        """A copy of the newest frame; the one before when none came in ``timeout_s``, None before the first."""
        with self._lock:
            lease = self._subscription.take(timeout_s)
            if lease is not None:
                with lease:
                    self._last = replace(lease.record, data=lease.record.data.copy())
            return self._last

    def counts(self) -> ConsumerCounts:
        """What it was offered and what became of it."""
        return self._subscription.counts()
