"""Reads a transducer at a steady rate on a thread of its own, and keeps what it reads."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable

from drivers.clock import Clock
from drivers.errors import DeviceError
from drivers.interfaces import PressureReading
from drivers.pressure.readings import ReadingRing

RETRY_S = 0.25
JOINED_WITHIN_S = 30.0
_LOG = logging.getLogger(__name__)


class Sampler:
    """One thread from `start` to `stop`; both may be called twice.

    Parameters
    ----------
    device : str
        Name of the device, for messages.
    clock : Clock
        The frames' clock.
    rate_hz : float
        Samples a second.
    ring : ReadingRing
        Takes the readings.
    take : callable
        Reads once; raises `DeviceError`.
    watch : callable
        Called after each attempt with the reading, or with the error.
    """

    def __init__(
        self,
        device: str,
        clock: Clock,
        rate_hz: float,
        ring: ReadingRing,
        take: Callable[[], PressureReading],
        watch: Callable[[PressureReading | DeviceError], None],
    ) -> None:
        self._device = device
        self._clock = clock
        self._period_s = 1.0 / rate_hz
        self._ring = ring
        self._take = take
        self._watch = watch
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin to sample."""
        if self._thread is None:
            self._stopping.clear()
            self._ring.clear()
            self._thread = threading.Thread(target=self._run, name=f"{self._device} sampler", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """End, and wait for the sample in progress."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join(JOINED_WITHIN_S)
            self._thread = None

    def _run(self) -> None:
        began_s = self._clock.now_s()
        place, lost = 0, False
        while not self._stopping.wait(max(0.0, began_s + place * self._period_s - self._clock.now_s())):
            try:
                reading = self._take()
                self._ring.add(place, reading)
                self._watch(reading)
                if lost:
                    lost = False
                    _LOG.info("%s: the pressure can be read again", self._device)
            except DeviceError as error:
                self._watch(error)
                if lost:
                    self._stopping.wait(RETRY_S)
                else:
                    lost = True
                    _LOG.warning("the pressure can not be read: %s", error)
            behind = math.floor((self._clock.now_s() - began_s) / self._period_s)
            place = max(place + 1, behind)
