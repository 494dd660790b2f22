"""A recording as a camera; see `drivers.interfaces.Camera`."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace

from bscd.acquisition.replay.options import ReplayOptions
from bscd.acquisition.replay.playback import Playback, Step
from bscd.acquisition.replay.recordings import Recording, open_recording
from bscd.errors import InputError
from drivers.clock import Clock
from drivers.errors import (
    DeviceBusyError,
    DeviceError,
    DeviceFaultError,
    DeviceTimeoutError,
    NotConnectedError,
    OutOfLimitsError,
)
from drivers.interfaces import CameraInfo, CameraStatus, Frame, Range

SLICE_S = 0.05
"""Longest wait of a reader before it looks again whether the stream was stopped."""
EXPOSURE_LIMITS_S = Range(1e-6, 10.0)
GAIN_LIMITS_DB = Range(0.0, 48.0)
RATE_LIMITS_HZ = Range(0.01, 1000.0)


@dataclass(frozen=True, slots=True)
class _Settings:
    exposure_s: float
    gain_db: float
    frame_rate_hz: float


@dataclass(slots=True)
class _Stream:
    due_s: float
    step: Step | None
    begun: bool = False
    delivered: int = 0
    lost: int = 0


class ReplayCamera:
    """Shows a recording, from where it is: `connect` begins at the first image, `snap` and `read` take the next one.

    Exposure and gain are told as they were set and change no image. Frames wait for a late reader, so none is lost
    that the recording has; frame ids jump where it has lost some, and frames keep their status. Times are those of
    the playing, on the clock.

    Parameters
    ----------
    options : ReplayOptions
        What is played, and how fast.
    name : str
        The device's name in this rig.
    clock : Clock
        Paces the images.
    """

    def __init__(self, options: ReplayOptions, name: str, clock: Clock) -> None:
        self.name = name
        self._options = options
        self._clock = clock
        self._settings = _Settings(options.exposure_s, options.gain_db, options.frame_rate_hz)
        self._lock = threading.RLock()
        self._recording: Recording | None = None
        self._playback: Playback | None = None
        self._stream: _Stream | None = None
        self._held: Step | None = None
        self._counts = (0, 0)

    def connect(self) -> None:
        """Open the recording; does nothing when it is open. Raises `NotConnectedError` when it can not be read."""
        with self._lock:
            if self._recording is not None:
                return
            try:
                recording = open_recording(self._options)
            except (InputError, OSError) as err:
                hint = "name a run file or a folder of images"
                raise NotConnectedError(self.name, f"opening the recording: {err}", hint) from err
            self._recording = recording
            self._playback = Playback(recording, self._options.repeat, self._period_s)

    def close(self) -> None:
        """Stop and close the recording."""
        with self._lock:
            self.stop()
            recording, self._recording = self._recording, None
            self._playback = self._held = None
            if recording is not None:
                recording.close()

    def info(self) -> CameraInfo:
        """Identity and capabilities, as the recording and the options tell."""
        camera, options = self._opened("asking for its identity").camera, self._options
        return CameraInfo(
            vendor=camera.vendor or "unknown",
            model=camera.model or "unknown",
            serial=camera.serial or options.source.name,
            width_px=camera.width_px,
            height_px=camera.height_px,
            pixel_size_mm=options.pixel_size_mm or camera.pixel_size_mm,
            bit_depth=camera.bit_depth,
            exposure_limits_s=EXPOSURE_LIMITS_S,
            gain_limits_db=GAIN_LIMITS_DB,
        )

    def status(self) -> CameraStatus:
        """State now."""
        stream, settings = self._stream, self._settings
        delivered, lost = (stream.delivered, stream.lost) if stream is not None else self._counts
        return CameraStatus(
            connected=self._recording is not None,
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
        """Change what is given; the rate holds from the next image on, exposure and gain are only told."""
        given = {"exposure_s": exposure_s, "gain_db": gain_db, "frame_rate_hz": frame_rate_hz}
        changes = {key: value for key, value in given.items() if value is not None}
        doing = "setting " + ", ".join(f"{key} = {value:g}" for key, value in changes.items())
        self._opened(doing)
        settings = replace(self._settings, **changes)
        for what, value, allowed, unit in (
            ("exposure", settings.exposure_s, EXPOSURE_LIMITS_S, "s"),
            ("gain", settings.gain_db, GAIN_LIMITS_DB, "dB"),
            ("frame rate", settings.frame_rate_hz, RATE_LIMITS_HZ, "Hz"),
        ):
            if not allowed.contains(value):
                hint = f"choose one from {allowed.low:g} to {allowed.high:g} {unit}"
                raise OutOfLimitsError(self.name, f"{doing}: the {what} is outside its limits", hint)
        if settings.exposure_s * settings.frame_rate_hz > 1.0:
            raise OutOfLimitsError(
                self.name,
                f"{doing}: an exposure of {settings.exposure_s:g} s does not fit {settings.frame_rate_hz:g} Hz",
                "lower the exposure or the frame rate",
            )
        self._settings = settings

    def snap(self, timeout_s: float = 5.0) -> Frame:
        """The next image, after the time of an exposure."""
        doing = "taking a frame"
        with self._lock:
            self._opened(doing)
            if self._stream is not None:
                raise DeviceBusyError(self.name, f"{doing}: it is streaming", "read the stream, or stop it first")
            self._counts = (0, 1)
            exposure_s = 0.0 if self._options.pace == "fast" else self._settings.exposure_s
            self._clock.sleep(min(exposure_s, timeout_s))
            if exposure_s > timeout_s:
                raise self._no_frame(doing, timeout_s)
            step = self._next(doing)
            if step is None:
                raise self._ended(doing)
            self._counts = (1, 0)
            return self._frame(step, self._clock.now_s())

    def start(self) -> None:
        """Begin to play from where the recording is."""
        doing = "starting the stream"
        with self._lock:
            self._opened(doing)
            if self._stream is not None:
                raise DeviceBusyError(self.name, f"{doing}: it is streaming already", "stop it first")
            exposure_s = 0.0 if self._options.pace == "fast" else self._settings.exposure_s
            self._stream = _Stream(self._clock.now_s() + exposure_s, self._next(doing))

    def read(self, timeout_s: float = 5.0) -> Frame:
        """The next image, when it is due; at the end of the recording it times out at once."""
        doing = "reading a frame"
        self._opened(doing)
        stream = self._stream
        if stream is None:
            raise DeviceTimeoutError(self.name, f"{doing}: it does not stream, so none will come", "start it first")
        deadline_s = self._clock.now_s() + timeout_s
        while True:
            with self._lock:
                self._opened(doing)
                if self._stream is not stream:
                    raise DeviceTimeoutError(self.name, f"{doing}: the stream was stopped meanwhile", "start it again")
                if stream.step is None:
                    raise self._ended(doing)
                now_s = self._clock.now_s()
                if stream.due_s <= now_s:
                    return self._deliver(stream, stream.step, doing)
                if now_s >= deadline_s:
                    raise self._no_frame(doing, timeout_s)
                wait_s = min(stream.due_s - now_s, deadline_s - now_s, SLICE_S)
            self._clock.sleep(wait_s)

    def stop(self) -> None:
        """End the stream; the image that was due next comes next again."""
        with self._lock:
            stream, self._stream = self._stream, None
            if stream is not None:
                self._counts = (stream.delivered, stream.lost)
                self._held = stream.step

    def _deliver(self, stream: _Stream, step: Step, doing: str) -> Frame:
        frame = self._frame(step, stream.due_s)
        stream.lost += step.missing if stream.begun else 0
        stream.delivered += 1
        stream.begun = True
        stream.step = self._next(doing)
        if stream.step is not None and self._options.pace != "fast":
            stream.due_s += stream.step.after_s
        return frame

    def _frame(self, step: Step, due_s: float) -> Frame:
        middle_s = due_s if self._options.pace == "fast" else due_s - self._settings.exposure_s / 2.0
        return Frame(
            step.image.data,
            step.frame_id,
            camera_time_ns=round(1e9 * middle_s),
            host_time_ns=round(1e9 * self._clock.now_s()),
            status=step.image.status,
        )

    def _next(self, doing: str) -> Step | None:
        held, self._held = self._held, None
        if held is not None:
            return held
        playback = self._playback
        if playback is None:
            return None
        try:
            return playback.next()
        except InputError as err:
            raise DeviceFaultError(self.name, f"{doing}: {err}", "repair the recording, or play another") from err

    def _period_s(self) -> float | None:
        return None if self._options.pace == "recorded" else 1.0 / self._settings.frame_rate_hz

    def _opened(self, doing: str) -> Recording:
        recording = self._recording
        if recording is None:
            raise NotConnectedError(self.name, f"{doing}: it is not connected", "call connect() first")
        return recording

    def _no_frame(self, doing: str, timeout_s: float) -> DeviceError:
        hint = "the next image is due later; wait longer, or raise the rate"
        return DeviceTimeoutError(self.name, f"{doing}: none came within {timeout_s:g} s", hint)

    def _ended(self, doing: str) -> DeviceError:
        return DeviceTimeoutError(self.name, f"{doing}: the recording is at its end", "connect again, or set repeat")
