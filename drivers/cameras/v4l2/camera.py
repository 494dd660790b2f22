"""A V4L2 camera through OpenCV; see `drivers.interfaces.Camera`."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

from drivers.cameras.v4l2.capture import OpenCapture, Settings, open_v4l2
from drivers.cameras.v4l2.connection import Connection, Stream
from drivers.cameras.v4l2.options import BITS, V4l2Options
from drivers.errors import DeviceBusyError, DeviceTimeoutError, NotConnectedError, OutOfLimitsError
from drivers.interfaces import CameraInfo, CameraStatus, Frame, Range
from drivers.registry import DriverContext


class V4l2Camera:
    """An area-scan camera that runs freely from `connect` on; safe to use from any thread.

    V4L2 frames have no number through OpenCV: ``frame_id`` and the lost frames are inferred from time stamps. A camera
    that is lost is opened again with growing pauses, set as it was, and streams on.

    Parameters
    ----------
    options : V4l2Options
        Which camera, and how it is set.
    context : DriverContext
        Its name and clock; the clock must be the host's monotonic one, which V4L2 stamps frames with.
    open_capture : callable
        Opens a path as a `cv2.VideoCapture` does.
    """

    def __init__(self, options: V4l2Options, context: DriverContext, open_capture: OpenCapture = open_v4l2) -> None:
        self.name = context.name
        self._options = options
        self._clock = context.clock
        self._open_capture = open_capture
        self._settings = Settings(options.exposure_s, options.gain_db, options.frame_rate_hz)
        self._opening = threading.RLock()
        self._commanding = threading.Lock()  # held through a snap, so taken before `_opening` and never by `close`
        self._connection: Connection | None = None
        self._stream: Stream | None = None
        self._counts = (0, 0)

    def connect(self) -> None:
        """Open the device and let it run; does nothing when it is open."""
        with self._opening:
            if self._connection is None:
                connection = Connection(self._options, self.name, self._clock, self._settings, self._open_capture)
                self._connection, self._settings = connection, connection.settings

    def close(self) -> None:
        """Stop streaming and release the device."""
        with self._opening:
            connection, self._connection = self._connection, None
            self._end_stream(connection)
            if connection is not None:
                connection.close()

    def info(self) -> CameraInfo:
        """Identity and capabilities; V4L2 tells little, so most is what the options say."""
        self._connected("asking for its identity")
        options = self._options
        return CameraInfo(
            vendor="V4L2",
            model=Path(options.device).name,
            serial=Path(options.device).name,
            width_px=options.width_px,
            height_px=options.height_px,
            pixel_size_mm=options.pixel_size_mm,
            bit_depth=BITS[options.pixel_format],
            exposure_limits_s=Range(*options.exposure_limits_s),
            gain_limits_db=Range(*options.gain_limits_db),
        )

    def status(self) -> CameraStatus:
        """State now; sends nothing."""
        connection, stream = self._connection, self._stream
        settings = connection.settings if connection is not None else self._settings
        delivered, lost = stream.counts() if stream is not None else self._counts
        return CameraStatus(
            connected=connection is not None and not connection.is_lost,
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
        """Change what is given, also during a stream; `CameraStatus` tells what the camera made of it."""
        given = {"exposure_s": exposure_s, "gain_db": gain_db, "frame_rate_hz": frame_rate_hz}
        changes = {key: value for key, value in given.items() if value is not None}
        doing = "setting " + ", ".join(f"{key} = {value:g}" for key, value in changes.items())
        with self._opening:
            connection = self._connected(doing)
            settings = replace(connection.settings, **changes)
            self._require_possible(settings, doing)
            if changes:
                connection.set(settings)
                self._settings = connection.settings

    def snap(self, timeout_s: float = 5.0) -> Frame:
        """One frame whose exposure began after this call, by its time stamp; another snap or start waits for it."""
        doing = "taking a frame"
        with self._commanding:
            connection = self._connected(doing)
            if self._stream is not None:
                raise DeviceBusyError(self.name, f"{doing}: it is streaming", "read the stream, or stop it first")
            stream = connection.open_stream(1)
            self._counts = (0, 1)
            try:
                frame = stream.queue.get(timeout_s)
            finally:
                connection.end_stream(stream)
            if frame is None:
                self._connected(doing)
                raise self._no_frame(connection, doing, timeout_s)
            self._counts = (1, 0)
            return frame

    def start(self) -> None:
        """Begin to hand over the frames."""
        doing = "starting the stream"
        with self._commanding, self._opening:
            connection = self._connected(doing)
            if self._stream is not None:
                raise DeviceBusyError(self.name, f"{doing}: it is streaming already", "stop it first")
            if connection.is_lost:
                raise connection.lost_error(doing)
            self._stream = connection.open_stream(self._options.buffer_frames)

    def read(self, timeout_s: float = 5.0) -> Frame:
        """The next streamed frame, oldest first; after a lost camera its first one when it is back in time."""
        doing = "reading a frame"
        connection = self._connected(doing)
        stream = self._stream
        if stream is None:
            raise DeviceTimeoutError(self.name, f"{doing}: it does not stream, so none will come", "start it first")
        frame = stream.queue.get(timeout_s)
        if frame is not None:
            return frame
        if self._connected(doing) is not connection or self._stream is not stream:
            raise DeviceTimeoutError(self.name, f"{doing}: the stream was stopped meanwhile", "start it again")
        raise self._no_frame(connection, doing, timeout_s)

    def stop(self) -> None:
        """End the stream and discard what nobody read; does nothing when there is none."""
        with self._opening:
            self._end_stream(self._connection)

    def _end_stream(self, connection: Connection | None) -> None:
        stream, self._stream = self._stream, None
        if stream is not None:
            self._counts = stream.counts()
            if connection is not None:
                connection.end_stream(stream)

    def _connected(self, doing: str) -> Connection:
        connection = self._connection
        if connection is None:
            raise NotConnectedError(self.name, f"{doing}: it is not connected", "call connect() first")
        return connection

    def _no_frame(self, connection: Connection, doing: str, timeout_s: float) -> NotConnectedError | DeviceTimeoutError:
        if connection.is_lost:
            return connection.lost_error(doing)
        hint = "check exposure, time-out and cable"
        return DeviceTimeoutError(self.name, f"{doing}: none came within {timeout_s:g} s", hint)

    def _require_possible(self, settings: Settings, doing: str) -> None:
        options = self._options
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
