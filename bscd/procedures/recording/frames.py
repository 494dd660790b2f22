"""Frames of a camera numbered by exposure, from 0: paced by the camera's own clock, or by the host's.

A number that is left out is an exposure whose frame did not come. The numbers are given here, before the ring, so that
whatever happens later can not hide a loss.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceTimeoutError, NotConnectedError
from drivers.interfaces import Camera, Frame

BY_CAMERA = "lost between camera and host"
SILENT_S = 5.0
"""Beyond an exposure, how long a connected camera may send nothing."""
_RETRY_S = 0.5


@dataclass(frozen=True, slots=True)
class Exposure:
    """An exposure's number and frame; ``reason`` is why those since the one before did not come, if they did not.

    It did not begin before ``not_before_ns`` of the host's clock, where that is known. ``after_absence``: the camera
    was away, or began to count anew, since the one before.
    """

    number: int
    frame: Frame
    reason: str = BY_CAMERA
    not_before_ns: int | None = None
    after_absence: bool = False


class NumberedFrames(Protocol):
    """A camera whose exposures are numbered."""

    def next(self, timeout_s: float) -> Exposure | None:
        """The next frame, None when none came in ``timeout_s``.

        Raises the camera's `DeviceError` when it has been silent or away for too long.
        """
        ...


class _Patience:
    """How long a camera may send nothing, and getting one back that went away."""

    def __init__(self, camera: Camera, clock: Clock, silent_s: float, away_s: float) -> None:
        self._camera = camera
        self._clock = clock
        self._silent_s = silent_s
        self._away_s = away_s
        self._heard_s = clock.now_s()
        self._tried_s = -_RETRY_S
        self.away = False
        self.absent_ns: int | None = None
        """When it was last found to be away, by the host's clock; None while it is there."""

    def heard(self) -> None:
        """A frame came."""
        self._heard_s = self._clock.now_s()
        self.away = False
        self.absent_ns = None

    def nothing(self, error: DeviceError, until_s: float, *, streams: bool) -> None:
        """No frame came: wait until then, try to get a lost camera back; raises the error when it takes too long."""
        now_s = self._clock.now_s()
        if isinstance(error, NotConnectedError):
            self.away, self.absent_ns = True, round(now_s * 1e9)
        if now_s - self._heard_s > (self._away_s if self.away else self._silent_s):
            raise error
        if self.away and now_s - self._tried_s >= _RETRY_S:
            self._tried_s = now_s
            with suppress(DeviceError):
                self._camera.connect()
                if streams and not self._camera.status().streaming:
                    self._camera.start()
        self._clock.sleep(until_s - self._clock.now_s())


class StreamedFrames:
    """Hardware pacing: the camera exposes by its own clock, and its frame ids number the exposures.

    A camera that was away may have begun to count anew; then the host's clock says how many exposures were missed.
    """

    def __init__(self, camera: Camera, clock: Clock, rate_hz: float, away_s: float) -> None:
        self._camera = camera
        self._clock = clock
        self._rate_hz = rate_hz
        silent_s = camera.status().exposure_s + 1.0 / rate_hz + SILENT_S
        self._started_ns = round(clock.now_s() * 1e9)
        camera.start()
        self._patience = _Patience(camera, clock, silent_s, away_s)
        self._first_id: int | None = None
        self._last: Exposure | None = None

    def next(self, timeout_s: float) -> Exposure | None:
        """The next frame, as `NumberedFrames` has it."""
        until_s = self._clock.now_s() + timeout_s
        try:
            frame = self._camera.read(timeout_s)
        except (DeviceTimeoutError, NotConnectedError) as error:
            self._patience.nothing(error, until_s, streams=True)
            return None
        if self._first_id is None or self._last is None:
            self._first_id = frame.frame_id - self._camera.status().lost_frames
            exposure = Exposure(frame.frame_id - self._first_id, frame, not_before_ns=self._started_ns)
        elif self._patience.away or frame.frame_id <= self._last.frame.frame_id:
            gone_s = (frame.host_time_ns - self._last.frame.host_time_ns) * 1e-9
            number = self._last.number + max(1, round(gone_s * self._rate_hz))
            self._first_id = frame.frame_id - number
            reason = f"the camera was away for {gone_s:.1f} s; their number is by the clock"
            exposure = Exposure(number, frame, reason, self._patience.absent_ns, after_absence=True)
        else:
            exposure = Exposure(frame.frame_id - self._first_id, frame)
        self._patience.heard()
        self._last = exposure
        return exposure


class SnappedFrames:
    """Software pacing: each frame is asked for at its time by the host's clock, for cameras that pace badly or not.

    An exposure whose time passes while the frame before is still awaited is left out.
    """

    def __init__(self, camera: Camera, clock: Clock, rate_hz: float, away_s: float) -> None:
        self._camera = camera
        self._clock = clock
        self._period_s = 1.0 / rate_hz
        self._exposure_s = camera.status().exposure_s
        self._patience = _Patience(camera, clock, self._exposure_s + self._period_s + SILENT_S, away_s)
        self._begun_s = clock.now_s()
        self._next = 0

    def next(self, timeout_s: float) -> Exposure | None:
        """The frame of the next exposure whose time has not passed, as `NumberedFrames` has it."""
        now_s = self._clock.now_s()
        passed = int((now_s - self._begun_s) / self._period_s)
        number = max(self._next, passed)
        due_s = self._begun_s + number * self._period_s
        if due_s - now_s > timeout_s:
            self._clock.sleep(timeout_s)
            return None
        self._clock.sleep(due_s - now_s)
        away, asked_ns = self._patience.away, round(self._clock.now_s() * 1e9)
        try:
            frame = self._camera.snap(self._exposure_s + max(timeout_s, self._period_s))
        except (DeviceTimeoutError, NotConnectedError) as error:
            self._patience.nothing(error, now_s + timeout_s, streams=False)
            return None
        self._patience.heard()
        self._next = number + 1
        reason = "the camera was away" if away else "not ready in time for the next exposure"
        return Exposure(number, frame, reason, asked_ns, after_absence=away)
