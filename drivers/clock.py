"""Where drivers and procedures get their time from: the host's clock, or a virtual one that tests turn."""

from __future__ import annotations

import heapq
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from typing import Protocol


class Appointment(Protocol):
    """A call that is to happen at a time."""

    def cancel(self) -> None:
        """Call it off; does nothing when it has happened."""
        ...


class Clock(Protocol):
    """A monotonic clock that can also wait."""

    def now_s(self) -> float:
        """Seconds since an arbitrary start; never goes back."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Wait; a duration below zero waits not at all."""
        ...

    def call_at(self, time_s: float, callback: Callable[[], None]) -> Appointment:
        """Have ``callback`` called once, from any thread, when the clock reads ``time_s`` (at once if it has)."""
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

    def call_at(self, time_s: float, callback: Callable[[], None]) -> Appointment:
        """Have ``callback`` called in a thread of its own."""
        timer = threading.Timer(max(0.0, time_s - self.now_s()), callback)
        timer.daemon = True
        timer.start()
        return timer


@dataclass(order=True)
class _VirtualAppointment:
    time_s: float
    order: int
    callback: Callable[[], None] | None = field(compare=False)

    def cancel(self) -> None:
        self.callback = None


class VirtualClock:
    """A clock that jumps: `sleep` returns at once with the time advanced, so a scan of minutes takes none.

    Appointments on the way are kept, in order and each at its own time, by the thread that sleeps.
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s
        self._lock = threading.Lock()
        self._agenda: list[_VirtualAppointment] = []
        self._order = count()

    def now_s(self) -> float:
        """Virtual seconds."""
        with self._lock:
            return self._now_s

    def sleep(self, duration_s: float) -> None:
        """Advance the clock by ``duration_s``."""
        if duration_s <= 0:
            return
        end_s = self.now_s() + duration_s
        while (callback := self._advance(end_s)) is not None:
            callback()

    def call_at(self, time_s: float, callback: Callable[[], None]) -> Appointment:
        """Have ``callback`` called by the first `sleep` that reaches ``time_s``."""
        with self._lock:
            appointment = _VirtualAppointment(time_s, next(self._order), callback)
            heapq.heappush(self._agenda, appointment)
        return appointment

    def _advance(self, end_s: float) -> Callable[[], None] | None:
        """Go to the next appointment and return its call, or go to ``end_s`` and return None."""
        with self._lock:
            while self._agenda and self._agenda[0].time_s <= end_s:
                appointment = heapq.heappop(self._agenda)
                if appointment.callback is not None:
                    self._now_s = max(self._now_s, appointment.time_s)
                    return appointment.callback
            self._now_s = max(self._now_s, end_s)
            return None
