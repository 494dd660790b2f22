"""One time base for frames and pressure: the camera's clock laid on the host's, which stamps the readings."""

from __future__ import annotations

import statistics
from collections import deque

from bscd.acquisition import TimeBase
from drivers.interfaces import Frame

#: Frames over which the shortest way from camera to host is sought; clocks drift apart by less than 1 ms in them.
_WINDOW = 256

#: A camera that keeps its rate reads a frame out within a period, and sends it within another.
_LONGEST_READOUT_PERIODS = 2.0

#: Of so many frames one comes without a delay that is worth mentioning.
_ENOUGH = 16

#: Time stamps are rounded to so much at worst.
_ROUNDING_NS = 1000


class ClockFit:
    """Where mid-exposures lie on the host's clock, as long as the camera's clock runs without a break.

    A frame arrives half an exposure, its readout and its way through the host after its camera's time stamp. The last
    varies and is never negative, so the shortest delay of many frames is taken for all. A readout that is not known
    lies between 0 and the longest that the first of these frames leave it: no exposure begins before it is asked for.

    Parameters
    ----------
    exposure_s
        Exposure time.
    readout_s
        From the end of an exposure to its frame's arrival; None when it is not known.
    likely_s
        What is taken for it when it is not known, or half of the longest that it can be, whichever is less.
    period_s
        From frame to frame.
    """

    def __init__(self, exposure_s: float, readout_s: float | None, likely_s: float, period_s: float) -> None:
        self._half_exposure_ns = round(exposure_s / 2.0 * 1e9)
        self._readout_ns = None if readout_s is None else round(readout_s * 1e9)
        self._likely_ns = round(likely_s * 1e9)
        self._two_periods_ns = round(_LONGEST_READOUT_PERIODS * period_s * 1e9)
        self._possible_ns: int | None = None
        self._earliest_ns: int | None = None
        self._differences: deque[int] = deque(maxlen=_WINDOW)
        self._used_ns: list[int] = []
        self._settled_ns: tuple[int, int] | None = None
        self._frames = 0

    def middle_ns(self, frame: Frame, not_before_ns: int | None = None) -> int:
        """The host's time at the middle of a frame's exposure, by the frames so far.

        The exposure can not have begun before ``not_before_ns`` by the host's clock.
        """
        self._differences.append(frame.host_time_ns - frame.camera_time_ns)
        self._frames += 1
        if self._frames <= _WINDOW:  # later the clocks have drifted
            self._limit_readout(frame, not_before_ns)
        offset_ns = self.offset_ns
        if self._frames < _ENOUGH:
            self._used_ns.append(offset_ns)
        else:
            lowest_ns, highest_ns = self._settled_ns or (offset_ns, offset_ns)
            self._settled_ns = min(lowest_ns, offset_ns), max(highest_ns, offset_ns)
        return frame.camera_time_ns + offset_ns

    @property
    def offset_ns(self) -> int:
        """The host's clock minus the camera's, by the frames so far."""
        return min(self._differences) - self._half_exposure_ns - self._taken_ns()

    @property
    def early_s(self) -> list[float]:
        """By how much more than all others, s, the first frames were laid too late, a value a frame."""
        return [(used_ns - self.offset_ns) * 1e-9 for used_ns in self._used_ns]

    def result(self) -> TimeBase | None:
        """The offset and the bound of its error, drift included; None without frames.

        The first frames were laid with less knowledge: see `early_s`.
        """
        if not self._differences:
            return None
        offset_ns, taken_ns = self.offset_ns, self._taken_ns()
        lowest_ns, highest_ns = self._settled_ns or (offset_ns, offset_ns)
        moved_ns = max(highest_ns - offset_ns, offset_ns - lowest_ns)
        if self._readout_ns is None:
            unknown_ns = max(taken_ns, self._longest_ns() - taken_ns)
        else:
            unknown_ns = statistics.median(self._differences) - min(self._differences)
        return TimeBase(offset_ns, (unknown_ns + moved_ns + _ROUNDING_NS) * 1e-9)

    def _limit_readout(self, frame: Frame, not_before_ns: int | None) -> None:
        if not_before_ns is not None:
            earliest_ns = not_before_ns + self._half_exposure_ns - frame.camera_time_ns
            self._earliest_ns = earliest_ns if self._earliest_ns is None else max(self._earliest_ns, earliest_ns)
        if self._earliest_ns is not None:
            possible_ns = min(self._differences) - self._half_exposure_ns - self._earliest_ns
            self._possible_ns = max(0, possible_ns)

    def _longest_ns(self) -> int:
        """The longest that the readout can be."""
        if self._possible_ns is None:
            return self._two_periods_ns
        return self._possible_ns if self._frames < _ENOUGH else min(self._possible_ns, self._two_periods_ns)

    def _taken_ns(self) -> int:
        return min(self._likely_ns, self._longest_ns() // 2) if self._readout_ns is None else self._readout_ns
