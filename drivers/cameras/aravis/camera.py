"""A GigE Vision or USB3 Vision camera through Aravis; see `drivers.interfaces.Camera`."""

from __future__ import annotations

import threading
from dataclasses import replace

from drivers.cameras.aravis.connection import Connection
from drivers.cameras.aravis.counters import FrameGap, StreamCounters
from drivers.cameras.aravis.device import Device, Settings
from drivers.cameras.aravis.options import AravisOptions
from drivers.cameras.aravis.streaming import Streaming
from drivers.errors import (
    DeviceBusyError,
    DeviceTimeoutError,
    NotConnectedError,
    OutOfLimitsError,
    UnsupportedError,
)
from drivers.interfaces import CameraInfo, CameraStatus, Frame, Range
from drivers.registry import DriverContext


class AravisCamera:
    """An area-scan camera; safe to use from any thread.

    A camera that is lost while connected is looked for with growing pauses, set up as it was, and streams on; until
    then commands raise `NotConnectedError`, and `read` waits for it until its time-out. ``connect`` raises
    `DeviceBusyError` when another program controls the camera.
    """

    def __init__(self, options: AravisOptions, context: DriverContext) -> None:
        self.name = context.name
        self._options = options
        self._clock = context.clock
        self._settings = Settings(options.exposure_s, options.gain_db, options.frame_rate_hz)
        self._opening = threading.RLock()
        self._connection: Connection | None = None
        self._counts = (0, 0)
        self._ended: Streaming | None = None

    def connect(self) -> None:
        """Find, open and set up the camera; does nothing when it is open."""
        with self._opening:
            if self._connection is None:
                connection = Connection(self._options, self.name, self._clock, self._settings)
                self._connection, self._settings = connection, connection.settings

    def close(self) -> None:
        """Stop streaming and release the camera."""
        with self._opening:
            connection, self._connection = self._connection, None
            if connection is not None:
                self._keep(connection.streaming)
                connection.close()

    def info(self) -> CameraInfo:
        """Identity and capabilities."""
        return self._connected("asking for its identity").info

    def status(self) -> CameraStatus:
        """State now; sends nothing."""
        connection = self._connection
        streaming = connection.streaming if connection is not None else None
        settings = connection.settings if connection is not None else self._settings
        delivered, lost = streaming.counts() if streaming is not None else self._counts
        return CameraStatus(
            connected=connection is not None and not connection.is_lost,
            streaming=streaming is not None,
            exposure_s=settings.exposure_s,
            gain_db=settings.gain_db,
            frame_rate_hz=settings.frame_rate_hz,
            delivered_frames=delivered,
            lost_frames=lost,
        )

    def configure(
        self, *, exposure_s: float | None = None, gain_db: float | None = None, frame_rate_hz: float | None = None
    ) -> None:
        """Change what is given, also during a stream; `CameraStatus` tells what the camera made of it."""
        given = {"exposure_s": exposure_s, "gain_db": gain_db, "frame_rate_hz": frame_rate_hz}
        changes = {key: value for key, value in given.items() if value is not None}
        doing = "setting " + ", ".join(f"{key} = {value:g}" for key, value in changes.items())
        connection = self._connected(doing)
        if not changes:
            return
        with connection.command(doing) as device:
            settings = replace(connection.settings, **changes)
            self._require_possible(device, settings, doing)
            connection.set(settings)
            self._settings = connection.settings

    def snap(self, timeout_s: float = 5.0) -> Frame:
        """One frame whose exposure began after this call."""
        doing = "taking a frame"
        connection = self._connected(doing)
        with connection.command(doing):
            if connection.streaming is not None:
                raise DeviceBusyError(self.name, f"{doing}: it is streaming", "read the stream, or stop it first")
            self._ended, self._counts = None, (0, 1)
            frame = connection.snap(timeout_s)
            self._counts = (1, 0)
            return frame

    def start(self) -> None:
        """Begin to stream, at the configured rate or as the configured trigger says."""
        doing = "starting the stream"
        connection = self._connected(doing)
        with connection.command(doing):
            if connection.streaming is not None:
                raise DeviceBusyError(self.name, f"{doing}: it is streaming already", "stop it first")
            connection.start()

    def read(self, timeout_s: float = 5.0) -> Frame:
        """The next streamed frame, oldest first; after a lost camera its first one when it is back in time."""
        doing = "reading a frame"
        connection = self._connected(doing)
        streaming = connection.streaming
        if streaming is None:
            raise DeviceTimeoutError(self.name, f"{doing}: it does not stream, so none will come", "start it first")
        frame = streaming.queue.get(timeout_s)
        if frame is not None:
            return frame
        if self._connected(doing) is not connection or connection.streaming is not streaming:
            raise DeviceTimeoutError(self.name, f"{doing}: the stream was stopped meanwhile", "start it again")
        if connection.is_lost:
            raise connection.lost_error(doing)
        hint = "check trigger, cable and network (docs/drivers/aravis.md)"
        raise DeviceTimeoutError(self.name, f"{doing}: none came within {timeout_s:g} s", hint)

    def stop(self) -> None:
        """End the stream and discard what nobody read; does nothing when there is none."""
        connection = self._connection
        if connection is None:
            return
        streaming = connection.streaming
        try:
            connection.stop()
        finally:
            self._keep(streaming)

    def trigger(self) -> None:
        """Start one exposure of a stream; needs the option ``trigger = "software"`` (`UnsupportedError`)."""
        doing = "triggering a frame"
        connection = self._connected(doing)
        if self._options.trigger != "software" or connection.streaming is None:
            hint = 'it streams at its rate, or not at all; set trigger = "software" and start it'
            raise UnsupportedError(self.name, f"{doing}: it does not wait for one", hint)
        with connection.command(doing) as device:
            device.trigger()

    def temperature_deg(self) -> float:
        """The camera's temperature in degrees Celsius, NaN when it does not tell."""
        doing = "reading the temperature"
        with self._connected(doing).command(doing) as device:
            return device.temperature_deg()

    def counters(self) -> StreamCounters:
        """What became of every frame of this stream, or of the last one."""
        connection = self._connection
        streaming = connection.streaming if connection is not None else None
        if connection is not None and streaming is not None:
            return streaming.counters(connection.wire_counters())
        return StreamCounters() if self._ended is None else self._ended.counters(StreamCounters())

    def gaps(self) -> tuple[FrameGap, ...]:
        """The times without a camera of this stream, or of the last one."""
        connection = self._connection
        streaming = connection.streaming if connection is not None else None
        streaming = streaming or self._ended
        return () if streaming is None else streaming.gaps()

    def _connected(self, doing: str) -> Connection:
        connection = self._connection
        if connection is None:
            raise NotConnectedError(self.name, f"{doing}: it is not connected", "call connect() first")
        return connection

    def _keep(self, streaming: Streaming | None) -> None:
        if streaming is not None:
            self._ended, self._counts = streaming, streaming.counts()

    def _require_possible(self, device: Device, settings: Settings, doing: str) -> None:
        info = device.info
        limits: list[tuple[str, float, Range, str]] = [
            ("exposure", settings.exposure_s, info.exposure_limits_s, "s"),
            ("gain", settings.gain_db, info.gain_limits_db, "dB"),
            ("frame rate", settings.frame_rate_hz, device.frame_rate_limits_hz(), "Hz"),
        ]
        for what, value, allowed, unit in limits:
            if not allowed.contains(value):
                hint = f"choose one from {allowed.low:g} to {allowed.high:g} {unit}"
                raise OutOfLimitsError(self.name, f"{doing}: the {what} is outside its limits", hint)
        if self._options.trigger == "off" and settings.exposure_s * settings.frame_rate_hz > 1.0:
            raise OutOfLimitsError(
                self.name,
                f"{doing}: an exposure of {settings.exposure_s:g} s does not fit {settings.frame_rate_hz:g} Hz",
                "lower the exposure or the frame rate",
            )
