"""Devices as the daemon hands them to procedures: moves go through the e-stop's latch, frames are seen by viewers."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from bscd.daemon.errors import EmergencyStoppedError
from bscd.daemon.latest import LatestFrames
from drivers.interfaces import (
    Axis,
    AxisInfo,
    AxisStatus,
    Camera,
    CameraInfo,
    CameraStatus,
    Frame,
    PressureInfo,
    PressureReading,
    PressureSource,
)


class Latch:
    """Closed by the e-stop, opened by an operator's reset; counts the motions that were let through.

    A motion that was let through just before the latch closed may begin after the stop command that it should have
    met: `under_way` tells, so that the stop is given again until none is left.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._closed = False
        self._under_way: Counter[str] = Counter()

    @property
    def closed(self) -> bool:
        """Whether nothing may move."""
        return self._closed

    def close(self) -> None:
        """From now on nothing is let through."""
        with self._lock:
            self._closed = True

    def open(self) -> None:
        """Let motions through again."""
        with self._lock:
            self._closed = False

    def under_way(self, device: str) -> bool:
        """Whether a motion of a device was let through and has not ended."""
        with self._lock:
            return self._under_way[device] > 0

    @contextmanager
    def motion(self, device: str, what: str) -> Iterator[None]:
        """Around a motion. Raises `EmergencyStoppedError` when the latch is closed; nothing was sent then."""
        with self._lock:
            if self._closed:
                raise EmergencyStoppedError(f"{device}: {what} refused, the e-stop is latched; reset it first")
            self._under_way[device] += 1
        try:
            yield
        finally:
            with self._lock:
                self._under_way[device] -= 1


class GuardedAxis:
    """An axis behind the latch; everything but moves goes straight to it."""

    def __init__(self, axis: Axis, latch: Latch) -> None:
        self._axis, self._latch = axis, latch
        self.name = axis.name

    def home(self) -> None:
        """As `Axis.home`; raises `EmergencyStoppedError` when the e-stop is latched."""
        with self._latch.motion(self.name, "homing"):
            self._axis.home()

    def move_to(self, position: float) -> None:
        """As `Axis.move_to`; raises `EmergencyStoppedError` when the e-stop is latched."""
        with self._latch.motion(self.name, f"a move to {position:g}"):
            self._axis.move_to(position)

    def connect(self) -> None:
        """As `Axis.connect`."""
        self._axis.connect()

    def close(self) -> None:
        """As `Axis.close`."""
        self._axis.close()

    def info(self) -> AxisInfo:
        """As `Axis.info`."""
        return self._axis.info()

    def status(self) -> AxisStatus:
        """As `Axis.status`."""
        return self._axis.status()

    def move_duration_s(self, position: float) -> float:
        """As `Axis.move_duration_s`."""
        return self._axis.move_duration_s(position)

    def stop(self) -> None:
        """As `Axis.stop`; never refused."""
        self._axis.stop()


class GuardedPressure:
    """A pressure source behind the latch; whatever else a driver offers is reached through it."""

    def __init__(self, source: PressureSource, latch: Latch) -> None:
        self._source, self._latch = source, latch
        self.name = source.name

    def set_pressure(self, pressure_kpa: float) -> None:
        """As `PressureSource.set_pressure`; raises `EmergencyStoppedError` when the e-stop is latched."""
        with self._latch.motion(self.name, f"a set-point of {pressure_kpa:g} kPa"):
            self._source.set_pressure(pressure_kpa)

    def connect(self) -> None:
        """As `PressureSource.connect`."""
        self._source.connect()

    def close(self) -> None:
        """As `PressureSource.close`."""
        self._source.close()

    def info(self) -> PressureInfo:
        """As `PressureSource.info`."""
        return self._source.info()

    def read(self) -> PressureReading:
        """As `PressureSource.read`."""
        return self._source.read()

    def set_point_kpa(self) -> float:
        """As `PressureSource.set_point_kpa`."""
        return self._source.set_point_kpa()

    def vent(self) -> None:
        """As `PressureSource.vent`; never refused."""
        self._source.vent()

    def __getattr__(self, name: str) -> Any:
        """The source's own; so a source that samples by itself still does."""
        return getattr(self._source, name)


class WatchedCamera:
    """A camera whose newest frame viewers can see; whatever else a driver offers is reached through it."""

    def __init__(self, camera: Camera, latest: LatestFrames) -> None:
        self._camera, self._latest = camera, latest
        self.name = camera.name

    def snap(self, timeout_s: float = 5.0) -> Frame:
        """As `Camera.snap`."""
        return self._seen(self._camera.snap(timeout_s))

    def read(self, timeout_s: float = 5.0) -> Frame:
        """As `Camera.read`."""
        return self._seen(self._camera.read(timeout_s))

    def connect(self) -> None:
        """As `Camera.connect`."""
        self._camera.connect()

    def close(self) -> None:
        """As `Camera.close`."""
        self._camera.close()

    def info(self) -> CameraInfo:
        """As `Camera.info`."""
        return self._camera.info()

    def status(self) -> CameraStatus:
        """As `Camera.status`."""
        return self._camera.status()

    def configure(
        self, *, exposure_s: float | None = None, gain_db: float | None = None, frame_rate_hz: float | None = None
    ) -> None:
        """As `Camera.configure`."""
        self._camera.configure(exposure_s=exposure_s, gain_db=gain_db, frame_rate_hz=frame_rate_hz)

    def start(self) -> None:
        """As `Camera.start`."""
        self._camera.start()

    def stop(self) -> None:
        """As `Camera.stop`."""
        self._camera.stop()

    def _seen(self, frame: Frame) -> Frame:
        self._latest.put(self.name, frame.data, frame.frame_id, frame.host_time_ns)
        return frame

    def __getattr__(self, name: str) -> Any:
        """The camera's own."""
        return getattr(self._camera, name)
