"""What a camera, an axis and a pressure source must do, for real and simulated ones alike.

Units are in the names. A driver raises only the errors of `drivers.errors`; a request outside its limits
raises `OutOfLimitsError` before anything reaches the device.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray


class FrameStatus(StrEnum):
    """Whether a frame can be trusted."""

    OK = "ok"
    INCOMPLETE = "incomplete"


@dataclass(frozen=True, slots=True)
class Frame:
    """One image and where it came from.

    ``data`` is ``(height, width)`` uint8 or uint16, read-only. ``frame_id`` counts up by one per exposure of
    the device (a jump is a lost frame). ``camera_time_ns`` is the device's clock at mid-exposure,
    ``host_time_ns`` the host's clock on arrival.
    """

    data: NDArray[np.uint8] | NDArray[np.uint16]
    frame_id: int
    camera_time_ns: int
    host_time_ns: int
    status: FrameStatus = FrameStatus.OK


@dataclass(frozen=True, slots=True)
class Range:
    """A closed interval of allowed values, in the unit of the quantity it limits."""

    low: float
    high: float

    def contains(self, value: float) -> bool:
        """Whether ``value`` lies in the interval, ends included; a NaN does not."""
        return self.low <= value <= self.high


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """Identity and capabilities of a camera."""

    vendor: str
    model: str
    serial: str
    width_px: int
    height_px: int
    pixel_size_mm: float
    bit_depth: int
    exposure_limits_s: Range
    gain_limits_db: Range
    firmware: str = ""
    """As the device tells; empty when it does not."""


@dataclass(frozen=True, slots=True)
class CameraStatus:
    """State of a camera now; ``lost_frames`` counts since `Camera.start` (or the last single snapshot)."""

    connected: bool
    streaming: bool
    exposure_s: float
    gain_db: float
    frame_rate_hz: float
    delivered_frames: int
    lost_frames: int


@runtime_checkable
class Camera(Protocol):
    """An area-scan camera."""

    name: str

    def connect(self) -> None:
        """Find and open the device; does nothing when it is open. Raises `NotConnectedError`."""
        ...

    def close(self) -> None:
        """Stop streaming and release the device; never raises, may be called twice."""
        ...

    def info(self) -> CameraInfo:
        """Identity and capabilities."""
        ...

    def status(self) -> CameraStatus:
        """State now, also without a connection; does not wait for a frame."""
        ...

    def configure(
        self, *, exposure_s: float | None = None, gain_db: float | None = None, frame_rate_hz: float | None = None
    ) -> None:
        """Change what is given; all values are checked before any is sent (`OutOfLimitsError`)."""
        ...

    def snap(self, timeout_s: float = 5.0) -> Frame:
        """One frame whose exposure began after this call.

        Raises `DeviceTimeoutError` when none comes, `DeviceBusyError` during a stream.
        """
        ...

    def start(self) -> None:
        """Begin to stream at the configured rate. Raises `DeviceBusyError` when it already does."""
        ...

    def read(self, timeout_s: float = 5.0) -> Frame:
        """The next streamed frame, oldest first.

        Raises `DeviceTimeoutError` when none comes, and at once when the camera does not stream.
        """
        ...

    def stop(self) -> None:
        """End the stream and discard what was not read; does nothing when there is none."""
        ...


@dataclass(frozen=True, slots=True)
class AxisInfo:
    """Identity and capabilities of an axis; every value in the axis's ``unit`` ("mm" or "deg")."""

    vendor: str
    model: str
    serial: str
    unit: str
    limits: Range
    resolution: float
    repeatability: float
    """One sigma of the true position about the reading after a move."""
    speed: float
    """Top speed, unit/s."""
    can_home: bool
    firmware: str = ""
    """As the device tells; empty when it does not."""


@dataclass(frozen=True, slots=True)
class AxisStatus:
    """State of an axis now; ``position`` and ``target`` in the axis's unit, NaN without a connection."""

    connected: bool
    homed: bool
    moving: bool
    position: float
    target: float
    fault: str = ""
    """The device's own alarm in words, empty when there is none."""


@runtime_checkable
class Axis(Protocol):
    """One motorised (or hand-turned) axis: a rotation or translation stage, or a pair of lab jacks."""

    name: str

    def connect(self) -> None:
        """Find and open the device; moves nothing. Raises `NotConnectedError`."""
        ...

    def close(self) -> None:
        """Stop the axis and release the device; never raises, may be called twice."""
        ...

    def info(self) -> AxisInfo:
        """Identity and capabilities."""
        ...

    def status(self) -> AxisStatus:
        """State now, also during a move or without a connection."""
        ...

    def move_duration_s(self, position: float) -> float:
        """Seconds that a move from here to ``position`` takes; moves nothing."""
        ...

    def home(self) -> None:
        """Find the reference position and return when there, homed."""
        ...

    def move_to(self, position: float) -> None:
        """Move to ``position`` and return when there and at rest.

        Raises `OutOfLimitsError` and `NotHomedError` before anything is sent, `DeviceBusyError` during
        another move, `MoveStoppedError` when stopped on the way, `DeviceTimeoutError` after a time-out
        computed from distance and speed, `DeviceFaultError` for a limit switch or a stall.
        """
        ...

    def stop(self) -> None:
        """Stop as fast as is safe, from any thread and in any state; does nothing at rest.

        Returns as soon as the command is given; the call that moves raises `MoveStoppedError` at rest.
        """
        ...


@dataclass(frozen=True, slots=True)
class PressureInfo:
    """Identity and capabilities of a pressure source."""

    vendor: str
    model: str
    serial: str
    limits_kpa: Range
    noise_kpa: float
    """One sigma of a reading."""
    can_set: bool
    """False for a transducer without a regulator."""
    firmware: str = ""
    """As the device tells; empty when it does not."""


@dataclass(frozen=True, slots=True)
class PressureReading:
    """One reading and the host's clock when it was taken."""

    pressure_kpa: float
    host_time_ns: int


@dataclass(frozen=True, slots=True)
class PressureReadings:
    """Readings of a source that samples by itself, oldest first, and how many are missing among them."""

    readings: tuple[PressureReading, ...]
    lost: int
    """Samples that were not taken in time, or that nobody fetched before they were overwritten."""


@runtime_checkable
class PressureSource(Protocol):
    """A pressure regulator with a transducer, gauge pressure."""

    name: str

    def connect(self) -> None:
        """Find and open the device; changes no pressure. Raises `NotConnectedError`."""
        ...

    def close(self) -> None:
        """Vent and release the device; never raises, may be called twice."""
        ...

    def info(self) -> PressureInfo:
        """Identity and capabilities."""
        ...

    def read(self) -> PressureReading:
        """The transducer now."""
        ...

    def set_point_kpa(self) -> float:
        """The last pressure asked for; 0 when vented."""
        ...

    def set_pressure(self, pressure_kpa: float) -> None:
        """Ask the regulator for a pressure and return at once. Raises `OutOfLimitsError` first."""
        ...

    def vent(self) -> None:
        """Open to the room, from any thread and in any state. Raises `NotConnectedError` when it can not."""
        ...


@runtime_checkable
class SampledPressureSource(PressureSource, Protocol):
    """A pressure source that samples its transducer by itself, from `connect` to `close`."""

    @property
    def sample_rate_hz(self) -> float:
        """How many samples a second it takes."""
        ...

    def readings_since(self, host_time_ns: int) -> PressureReadings:
        """The samples taken after ``host_time_ns``; ask with the last one's time to get each once.

        Does not wait for the device. Raises `NotConnectedError`.
        """
        ...
