"""The pressure during an inflation: brought to rest, read into the log, and watched."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable

import numpy as np

from bscd.errors import CheckFailedError
from bscd.procedures.progress import require_going
from bscd.procedures.recording.recipes import InflationRecipe
from bscd.procedures.recording.result import Ending
from drivers.clock import Clock
from drivers.interfaces import PressureReading, PressureSource, SampledPressureSource

#: Readings in a row that must be at rest, and the time between them.
_AT_REST_READINGS = 5
_BETWEEN_READINGS_S = 0.1

#: Readings in a row that end an inflation: one alone may be a spike on the line.
_READINGS_TO_END = 2

#: Readings kept for interpolation.
_KEPT = 512


class PressureTrace:
    """Readings of a source as they come: each goes to ``log`` once, the newest are kept for interpolation."""

    def __init__(self, source: PressureSource, log: Callable[[PressureReading], None]) -> None:
        self._source = source
        self._log = log
        self._kept: deque[PressureReading] = deque(maxlen=_KEPT)
        self.lost = 0

    def read(self) -> tuple[PressureReading, ...]:
        """What is new since the last call; a source that samples by itself may have nothing yet."""
        if isinstance(self._source, SampledPressureSource) and self._kept:
            sampled = self._source.readings_since(self._kept[-1].host_time_ns)
            self.lost += sampled.lost
            new = sampled.readings
        else:
            new = (self._source.read(),)
        for reading in new:
            self._log(reading)
        self._kept.extend(new)
        return new

    @property
    def latest_kpa(self) -> float:
        """The newest reading."""
        return self._kept[-1].pressure_kpa

    def at_kpa(self, host_time_ns: int) -> float:
        """The pressure at a time of the host's clock, linear between readings; the nearest beyond them."""
        since_s = [(reading.host_time_ns - host_time_ns) * 1e-9 for reading in self._kept]
        return float(np.interp(0.0, since_s, [reading.pressure_kpa for reading in self._kept]))


class PressureWatch:
    """Ends an inflation when the pressure goes too high, or falls as it does when the membrane bursts."""

    def __init__(self, recipe: InflationRecipe, noise_kpa: float) -> None:
        self._limit_kpa = recipe.highest_kpa
        self._fall = recipe.burst_fall
        self._noise_kpa = known_noise_kpa(noise_kpa)
        self._highest_kpa = -math.inf
        self._counts = {Ending.LIMIT: 0, Ending.BURST: 0}
        self.reason = ""

    def ending(self, readings: tuple[PressureReading, ...], *, resting: bool = False) -> Ending | None:
        """What these readings end the inflation with; None when they do not.

        While it comes to rest (``resting``) the pressure may fall.
        """
        for kpa in (reading.pressure_kpa for reading in readings):
            if not resting:
                self._highest_kpa = max(self._highest_kpa, kpa)
            fallen_kpa = self._highest_kpa - kpa
            burst = bool(self._fall) and fallen_kpa > max(self._fall * self._highest_kpa, 10.0 * self._noise_kpa, 0.1)
            high = kpa > self._limit_kpa + 3.0 * self._noise_kpa
            for ending, now in ((Ending.LIMIT, high), (Ending.BURST, burst)):
                self._counts[ending] = self._counts[ending] + 1 if now else 0
                if self._counts[ending] >= _READINGS_TO_END:
                    self.reason = (
                        f"the pressure fell from {self._highest_kpa:.2f} to {kpa:.2f} kPa: the membrane burst or leaks"
                        if ending is Ending.BURST
                        else f"the pressure reached {kpa:.2f} kPa, above its limit of {self._limit_kpa:g} kPa"
                    )
                    return ending
        return None


def come_to_rest(
    trace: PressureTrace,
    watch: PressureWatch,
    recipe: InflationRecipe,
    noise_kpa: float,
    clock: Clock,
    stop: threading.Event | None,
) -> None:
    """Let the pressure settle, then wait until it has been at rest for a few readings, watched all the while.

    Raises `CheckFailedError` when it does not come to rest in the recipe's time or goes above its limit, and
    `ProcedureStoppedError` when ``stop`` was set.
    """
    allowed_kpa = recipe.rest_tolerance_kpa + 3.0 * known_noise_kpa(noise_kpa)
    settled_s = clock.now_s() + recipe.rest_settle_s
    end_s = settled_s + recipe.rest_timeout_s
    at_rest = 0
    while at_rest < _AT_REST_READINGS:
        require_going(stop, "inflation: before the first frame")
        new = trace.read()
        if watch.ending(new, resting=True) is not None:
            raise CheckFailedError(
                f"inflation: before the first frame {watch.reason}; look at the regulator and its supply"
            )
        now_s = clock.now_s()
        if now_s >= settled_s:
            near = abs(trace.latest_kpa - recipe.rest_kpa) <= allowed_kpa
            at_rest = at_rest + bool(new) if near else 0
            if now_s >= end_s and not (near and new):
                raise CheckFailedError(
                    f"inflation: the pressure is {trace.latest_kpa:.3f} kPa after {recipe.rest_timeout_s:g} s, not "
                    f"{recipe.rest_kpa:g}; look for a leak, or allow more with rest_tolerance_kpa"
                )
        clock.sleep(_BETWEEN_READINGS_S)


def known_noise_kpa(noise_kpa: float) -> float:
    """A source's noise; 0 where it does not say."""
    return noise_kpa if math.isfinite(noise_kpa) else 0.0
