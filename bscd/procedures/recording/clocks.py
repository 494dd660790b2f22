"""One time base for frames and pressure: the camera's clock laid on the host's, which stamps the readings."""

from __future__ import annotations

import statistics
from collections import deque

from bscd.acquisition import TimeBase
from drivers.interfaces import Frame

#: Frames over which the shortest way from camera to host is sought; clocks drift apart by less than 1 ms in them.
_WINDOW = 256


class ClockFit:
    """Where mid-exposures lie on the host's clock.

    A frame arrives half an exposure, its readout and its way through the host after its camera's time stamp. The last
    varies and is never negative, so the shortest delay of many frames is taken for all. The readout is known, or lies
    between 0 and ``readout_limit_s`` and counts as half of it.

    Parameters
    ----------
    exposure_s
        Exposure time.
    readout_s
        From the end of an exposure to its frame's arrival; None when it is not known.
    readout_limit_s
        Its bound when it is not known.
    """

    def __init__(self, exposure_s: float, readout_s: float | None, readout_limit_s: float) -> None:
        known_s = readout_limit_s / 2.0 if readout_s is None else readout_s
        self._uncertain_s = readout_limit_s / 2.0 if readout_s is None else 0.0
        self._delay_ns = round((exposure_s / 2.0 + known_s) * 1e9)
        self._differences: deque[int] = deque(maxlen=_WINDOW)

    def middle_ns(self, frame: Frame) -> int:
        """The host's time at the middle of a frame's exposure, by the frames so far."""
        self._differences.append(frame.host_time_ns - frame.camera_time_ns)
        return frame.camera_time_ns + self._offset_ns()

    def result(self) -> TimeBase | None:
        """The offset and the bound of its error: the readout's, and how much the delays differ; None without frames."""
        if not self._differences:
            return None
        spread_ns = statistics.median(self._differences) - min(self._differences)
        return TimeBase(self._offset_ns(), self._uncertain_s + spread_ns * 1e-9)

    def _offset_ns(self) -> int:
        return min(self._differences) - self._delay_ns
