"""A camera on the twin: exposure, gain, single frames and a paced stream, with noise of its own."""

from __future__ import annotations

import threading
import zlib
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceBusyError, DeviceError, DeviceFaultError, DeviceTimeoutError, OutOfLimitsError
from drivers.interfaces import CameraInfo, CameraStatus, Frame, Range
from drivers.registry import DriverContext
from drivers.simulated.faults import Fault, Faults
from drivers.simulated.link import Link
from drivers.simulated.options import SimulatedCameraOptions
from drivers.simulated.stream import FrameStream, Pace
from drivers.simulated.world import PhysicalWorld, world_of


@dataclass(frozen=True, slots=True)
class _Settings:
    exposure_s: float
    gain_db: float
    frame_rate_hz: float


class SimulatedCamera:
    """An area-scan camera that sees the twin's world; see `drivers.interfaces.Camera`.

    Attributes
    ----------
    faults : Faults
        Where faults are injected.
    options : SimulatedCameraOptions
        What it was made of.
    world : PhysicalWorld
        What it sees; for emulators.
    """

    def __init__(self, options: SimulatedCameraOptions, context: DriverContext) -> None:
        self.name = context.name
        self.faults = Faults(context.name, [Fault.NO_ANSWER, Fault.DROPPED_FRAME])
        self.options = options
        self._clock = context.clock
        self.world: PhysicalWorld = world_of(context)
        self._link = Link(context.name, context.clock, self.faults, options.answer_timeout_s)
        self._rng = np.random.default_rng([options.seed, zlib.crc32(context.name.encode())])
        self._settings = _Settings(options.exposure_s, options.gain_db, options.frame_rate_hz)
        self._command = threading.RLock()
        self._exposing = threading.Lock()
        self._stream: FrameStream | None = None
        self._counts = (0, 0)
        self._frame_id = 0

    def connect(self) -> None:
        """Open the connection."""
        self._link.open()

    def close(self) -> None:
        """Stop streaming and close the connection."""
        with suppress(DeviceError):
            self.stop()
        self._link.close()

    def info(self) -> CameraInfo:
        """Identity and capabilities."""
        self._link.ask("asking for its identity")
        optics = self.world.optics(self.options.camera)
        return CameraInfo(
            vendor="bscd",
            model=f"digital twin {self.options.camera} camera",
            serial=f"twin-{self.name}",
            width_px=optics.width_px,
            height_px=optics.height_px,
            pixel_size_mm=optics.pixel_size_mm,
            bit_depth=self.world.options.sensor.bits,
            exposure_limits_s=Range(*self.options.exposure_limits_s),
            gain_limits_db=Range(*self.options.gain_limits_db),
        )

    def status(self) -> CameraStatus:
        """State now."""
        connected = self._link.is_open
        if connected:
            self._link.ask("asking for its status")
        stream, settings = self._stream, self._settings
        delivered, lost = stream.counts() if stream else self._counts
        return CameraStatus(
            connected=connected,
            streaming=stream is not None,
            exposure_s=settings.exposure_s,
            gain_db=settings.gain_db,
            frame_rate_hz=settings.frame_rate_hz,
            delivered_frames=delivered,
            lost_frames=lost,
        )

    def configure(
        self, *, exposure_s: float | None = None, gain_db: float | None = None, frame_rate_hz: float | None = None
    ) -> None:
        """Change what is given, also during a stream; it holds from the next exposure on."""
        given = {"exposure_s": exposure_s, "gain_db": gain_db, "frame_rate_hz": frame_rate_hz}
        changes = {key: value for key, value in given.items() if value is not None}
        doing = "setting " + ", ".join(f"{key} = {value:g}" for key, value in changes.items())
        self._link.require_open(doing)
        with self._command:
            settings = replace(self._settings, **changes)
            self._require_possible(settings, doing)
            self._link.ask(doing)
            self._settings = settings

    def snap(self, timeout_s: float = 5.0) -> Frame:
        """One frame whose exposure begins now. Raises `DeviceBusyError` during a stream."""
        doing = "taking a frame"
        with self._command:
            self._link.require_open(doing)
            if self._stream is not None:
                raise DeviceBusyError(self.name, f"{doing}: it is streaming", "read the stream, or stop it first")
            self._link.ask(doing, within_s=timeout_s)
            exposure_s = self._settings.exposure_s
            start_s = self._clock.now_s()
            arrival_s = start_s + exposure_s + self.options.readout_s
            self._clock.sleep(exposure_s / 2.0)
            frame = self._take(arrival_s, wanted=arrival_s - start_s <= timeout_s)
            self._counts = (0, 1) if frame is None else (1, 0)
            end_s = start_s + timeout_s if frame is None else arrival_s
            while (left_s := end_s - self._clock.now_s()) > 0.0:
                self._clock.sleep(left_s)
        self._link.require_open(doing)
        if frame is None:
            raise self._no_frame(doing, timeout_s)
        return frame

    def start(self) -> None:
        """Begin to stream at the configured rate."""
        doing = "starting the stream"
        with self._command:
            self._link.require_open(doing)
            if self._stream is not None:
                raise DeviceBusyError(self.name, f"{doing}: it is streaming already", "stop it first")
            self._link.ask(doing)
            self._stream = FrameStream(self._clock, self._take, self._pace, self.options.buffer_frames)

    def read(self, timeout_s: float = 5.0) -> Frame:
        """The next streamed frame, oldest first."""
        doing = "reading a frame"
        self._link.require_open(doing)
        stream = self._stream
        if stream is None:
            raise DeviceTimeoutError(self.name, f"{doing}: it does not stream, so none will come", "start it first")
        frame = stream.read(timeout_s)
        if frame is not None:
            return frame
        self._link.require_open(doing)
        if self._stream is not stream:
            raise DeviceTimeoutError(self.name, f"{doing}: the stream was stopped meanwhile", "start it again")
        raise self._no_frame(doing, timeout_s)

    def stop(self) -> None:
        """End the stream and discard what nobody read; does nothing when there is none."""
        with self._command:
            stream, self._stream = self._stream, None
            if stream is None:
                return
            stream.stop()
            self._counts = stream.counts()
            self._link.ask("stopping the stream")

    def expose(self, exposure_s: float, gain_db: float) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """What the sensor reads now, ``(height, width)``, with the camera's own noise; for emulators."""
        with self._exposing:
            return self.world.expose(self.options.camera, exposure_s=exposure_s, gain_db=gain_db, rng=self._rng)

    def _take(self, arrival_s: float, wanted: bool) -> Frame | None:
        """The frame of the exposure whose middle is now, None when it is lost on the way."""
        with self._exposing:
            frame_id, self._frame_id = self._frame_id, self._frame_id + 1
            if not wanted or Fault.NO_ANSWER in self.faults.active() or self.faults.strike(Fault.DROPPED_FRAME):
                return None
            settings, middle_s = self._settings, self._clock.now_s()
            try:
                data = self.world.expose(
                    self.options.camera, exposure_s=settings.exposure_s, gain_db=settings.gain_db, rng=self._rng
                )
            except Exception as error:
                hint = "check the twin's options"
                raise DeviceFaultError(self.name, f"the digital twin gave no image: {error}", hint) from error
        data.setflags(write=False)
        arrived_s = max(arrival_s, self._clock.now_s())
        return Frame(data, frame_id, camera_time_ns=round(middle_s * 1e9), host_time_ns=round(arrived_s * 1e9))

    def _pace(self) -> Pace:
        settings = self._settings
        return Pace(1.0 / settings.frame_rate_hz, settings.exposure_s, self.options.readout_s)

    def _require_possible(self, settings: _Settings, doing: str) -> None:
        options = self.options
        for what, value, (low, high), unit in (
            ("exposure", settings.exposure_s, options.exposure_limits_s, "s"),
            ("gain", settings.gain_db, options.gain_limits_db, "dB"),
            ("frame rate", settings.frame_rate_hz, options.frame_rate_limits_hz, "Hz"),
        ):
            if not low <= value <= high:
                hint = f"choose one from {low:g} to {high:g} {unit}"
                raise OutOfLimitsError(self.name, f"{doing}: the {what} is outside its limits", hint)
        if settings.exposure_s * settings.frame_rate_hz > 1.0:
            raise OutOfLimitsError(
                self.name,
                f"{doing}: an exposure of {settings.exposure_s:g} s does not fit {settings.frame_rate_hz:g} Hz",
                "lower the exposure or the frame rate",
            )

    def _no_frame(self, doing: str, timeout_s: float) -> DeviceTimeoutError:
        return DeviceTimeoutError(
            self.name, f"{doing}: none came within {timeout_s:g} s", "check the camera's cable and its time-out"
        )
