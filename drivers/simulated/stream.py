"""A stream of frames at a steady rate: each is exposed at its own time and held for the reader when it arrived."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from drivers.clock import Appointment, Clock
from drivers.interfaces import Frame

SLICE_S = 0.05
"""Longest wait of a reader before it looks again whether the stream was stopped."""
LATE_S = 0.001
"""Wait for a frame that is due and still being made."""


@dataclass(frozen=True, slots=True)
class Pace:
    """Times of one exposure, s: to the next one's start, its own length, its end to the frame's arrival."""

    period_s: float
    exposure_s: float
    readout_s: float


class FrameStream:
    """Exposes from its making until `stop`; safe to use from any thread.

    A frame for which the buffer has no room, or whose time passed while the frame before was being made, is lost.

    Parameters
    ----------
    clock : Clock
        Paces the exposures.
    take : callable
        ``take(arrival_s, wanted)`` makes the frame of an exposure whose middle is now; None when it is lost. A
        frame that is not ``wanted`` only counts.
    pace : callable
        The times that hold for the next exposure.
    buffer_frames : int
        How many frames are held.
    """

    def __init__(
        self,
        clock: Clock,
        take: Callable[[float, bool], Frame | None],
        pace: Callable[[], Pace],
        buffer_frames: int,
    ) -> None:
        self._clock = clock
        self._take = take
        self._pace = pace
        self._capacity = buffer_frames
        self._lock = threading.Lock()
        self._buffer: deque[tuple[float, Frame]] = deque()
        self._running = True
        self._failure: Exception | None = None
        self._delivered = self._lost = 0
        with self._lock:
            self._appointment = self._appoint(clock.now_s())

    def stop(self) -> None:
        """End the stream; frames that nobody read are discarded."""
        with self._lock:
            self._running = False
            self._buffer.clear()
            self._appointment.cancel()

    def counts(self) -> tuple[int, int]:
        """Frames delivered to the reader, and frames lost."""
        with self._lock:
            return self._delivered, self._lost

    def read(self, timeout_s: float) -> Frame | None:
        """The oldest frame, or None when none came in ``timeout_s`` or the stream was stopped."""
        deadline_s = self._clock.now_s() + timeout_s
        while True:
            now_s = self._clock.now_s()
            with self._lock:
                if self._failure is not None:
                    raise self._failure
                if not self._running:
                    return None
                if self._buffer and self._buffer[0][0] <= now_s:
                    self._delivered += 1
                    return self._buffer.popleft()[1]
                next_s = self._buffer[0][0] if self._buffer else self._arrival_s
            if now_s >= deadline_s:
                return None
            wait_s = next_s - now_s if next_s > now_s else LATE_S
            self._clock.sleep(min(wait_s, deadline_s - now_s, SLICE_S))

    def _appoint(self, start_s: float) -> Appointment:
        """Plan the exposure that starts at ``start_s``; the lock is held."""
        times = self._pace()
        self._next_start_s = start_s + times.period_s
        self._arrival_s = start_s + times.exposure_s + times.readout_s
        return self._clock.call_at(start_s + times.exposure_s / 2.0, self._expose)

    def _expose(self) -> None:
        """Make the frame whose middle is now, and plan the next."""
        with self._lock:
            if not self._running:
                return
            wanted = len(self._buffer) < self._capacity
            arrival_s = self._arrival_s
        try:
            frame = self._take(arrival_s, wanted)
            missed = 0
            while self._next_start_s + self._pace().period_s < self._clock.now_s():
                self._take(self._next_start_s, False)
                self._next_start_s += self._pace().period_s
                missed += 1
        except Exception as error:
            with self._lock:
                self._failure = error
            return
        with self._lock:
            if not self._running:
                return
            self._lost += missed + (frame is None)
            if frame is not None:
                self._buffer.append((arrival_s, frame))
            self._appointment = self._appoint(self._next_start_s)
