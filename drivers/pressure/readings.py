"""A ring of the last readings, each with its place in the series, so that missing ones are counted."""

from __future__ import annotations

import threading
from collections import deque

from drivers.interfaces import PressureReading, PressureReadings


class ReadingRing:
    """Holds the last ``capacity`` readings; safe to use from any thread."""

    def __init__(self, capacity: int) -> None:
        self._lock = threading.Lock()
        self._kept: deque[tuple[int, PressureReading]] = deque(maxlen=capacity)
        self._last_gone: tuple[int, int] | None = None

    def add(self, place: int, reading: PressureReading) -> None:
        """Keep a reading; ``place`` counts up by one a sample, a jump says how many were not taken."""
        with self._lock:
            if len(self._kept) == self._kept.maxlen:
                gone_place, gone = self._kept[0]
                self._last_gone = gone_place, gone.host_time_ns
            self._kept.append((place, reading))

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            self._kept.clear()
            self._last_gone = None

    def since(self, host_time_ns: int) -> PressureReadings:
        """Those later than ``host_time_ns``, and how many are missing between the one before them and the last.

        Of readings that were overwritten at least one is counted; all of them when ``host_time_ns`` is that of a
        reading still kept or of the last one gone.
        """
        later: list[tuple[int, PressureReading]] = []
        before: int | None = None
        with self._lock:
            gone = self._last_gone
            for place, reading in reversed(self._kept):
                if reading.host_time_ns <= host_time_ns:
                    before = place
                    break
                later.append((place, reading))
        if not later:
            return PressureReadings((), 0)
        later.reverse()
        if before is not None:
            first = before + 1
        elif gone is None:
            first = 0
        else:
            first = self._place_after(host_time_ns, gone, later[0])
        return PressureReadings(tuple(reading for _, reading in later), later[-1][0] - first + 1 - len(later))

    @staticmethod
    def _place_after(host_time_ns: int, gone: tuple[int, int], oldest: tuple[int, PressureReading]) -> int:
        """The place that followed ``host_time_ns``, by the spacing of the readings about the end of the ring."""
        place, time_ns = gone
        if host_time_ns >= time_ns:
            return place + 1
        spacing_ns = (oldest[1].host_time_ns - time_ns) / (oldest[0] - place)
        return max(0, place + 1 - max(1, round((time_ns - host_time_ns) / spacing_ns)))
