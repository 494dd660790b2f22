"""One V4L2 camera from connect to close: its one grabbing thread, and opening it again when it is lost."""

from __future__ import annotations

import logging
import threading

from drivers.cameras.frame_queue import FrameQueue
from drivers.cameras.v4l2.capture import (
    Capture,
    OpenCapture,
    Settings,
    apply,
    grabbed,
    grey_image,
    open_camera,
    time_stamp_ns,
)
from drivers.cameras.v4l2.inference import InferredCount
from drivers.cameras.v4l2.options import V4l2Options
from drivers.clock import Clock
from drivers.errors import DeviceError, NotConnectedError
from drivers.interfaces import Frame

CLOSE_TIMEOUT_S = 15.0
"""OpenCV waits up to 10 s for a frame that does not come."""

_log = logging.getLogger(__name__)


class Stream:
    """Frames for one reader, of exposures that began after its making, and what seems lost among them."""

    def __init__(self, capacity: int, since_ns: int) -> None:
        self.queue = FrameQueue(capacity)
        self.since_ns = since_ns
        self.begun = False
        self.inferred_missing = 0
        self.broken = 0

    def counts(self) -> tuple[int, int]:
        """Frames delivered, and frames lost: inferred from time stamps, broken, or without room."""
        delivered, overrun = self.queue.counts()
        return delivered, overrun + self.inferred_missing + self.broken


class Connection:
    """Opens the camera when made; safe to use from any thread. Raises what `open_camera` raises."""

    def __init__(
        self, options: V4l2Options, name: str, clock: Clock, settings: Settings, open_capture: OpenCapture
    ) -> None:
        self._options = options
        self._name = name
        self._clock = clock
        self._open_capture = open_capture
        self._capture: Capture | None = open_camera(open_capture, options, name)
        self.settings = apply(self._capture, settings, options)
        self._count = InferredCount()
        self._lock = threading.RLock()
        self._stream: Stream | None = None
        self._closing = threading.Event()
        self._last_frame_s = clock.now_s()
        self._is_lost = False
        self._pause_s = options.reconnect_s[0]
        self._thread = threading.Thread(target=self._grab, name=f"{name}-frames", daemon=True)
        self._thread.start()

    @property
    def is_lost(self) -> bool:
        """Whether no frames come: the device is gone, or silent beyond its time-out."""
        silent_s = self._clock.now_s() - self._last_frame_s
        return self._is_lost or silent_s > self._options.stall_timeout_s + 2.0 / self.settings.frame_rate_hz

    def lost_error(self, doing: str) -> NotConnectedError:
        """What a command raises while the camera is lost."""
        hint = "it is looked for; check its cable"
        return NotConnectedError(self._name, f"{doing}: the camera is lost, no frames come", hint)

    def set(self, settings: Settings) -> None:
        """Change the settings. Raises `NotConnectedError` while the camera is lost."""
        with self._lock:
            if self._capture is None:
                raise self.lost_error("changing its settings")
            self.settings = apply(self._capture, settings, self._options)
            self._count.restart()

    def open_stream(self, capacity: int) -> Stream:
        """Begin to hand frames over, of exposures that begin from now on."""
        stream = Stream(capacity, round(1e9 * self._clock.now_s()))
        with self._lock:
            self._stream = stream
        return stream

    def end_stream(self, stream: Stream) -> None:
        """Stop to hand frames over."""
        with self._lock:
            if self._stream is stream:
                self._stream = None
        stream.queue.close()

    def close(self) -> None:
        """End the thread and release the device; waits for a frame that is under way."""
        self._closing.set()
        self._thread.join(CLOSE_TIMEOUT_S)
        with self._lock:
            stream, self._stream = self._stream, None
            self._release()
        if stream is not None:
            stream.queue.close()

    def _grab(self) -> None:
        while not self._closing.is_set():
            capture = self._capture
            if capture is None:
                self._look_again()
            elif grabbed(capture):
                self._take(capture)
            else:
                self._lose()

    def _take(self, capture: Capture) -> None:
        now_s = self._clock.now_s()
        host_ns = round(1e9 * now_s)
        with self._lock:
            if self._is_lost:
                self._note_return(now_s - self._last_frame_s)
            self._last_frame_s = now_s
            stamp_ns = time_stamp_ns(capture)
            stamp_ns = host_ns if stamp_ns is None else stamp_ns
            settings, stream = self.settings, self._stream
            frame_id, missing = self._count.count(stamp_ns, 1.0 / settings.frame_rate_hz)
            exposure_ns = round(1e9 * settings.exposure_s)
            start_ns = (
                stamp_ns - {"start": 0, "middle": exposure_ns // 2, "end": exposure_ns}[self._options.time_stamp_at]
            )
            if stream is None or start_ns < stream.since_ns:
                return
            image = grey_image(capture, self._options)
            stream.inferred_missing += missing if stream.begun else 0
            stream.begun = True
            if image is None:
                stream.broken += 1
                return
        stream.queue.put(Frame(image, frame_id, start_ns + exposure_ns // 2, host_ns))

    def _lose(self) -> None:
        with self._lock:
            again, self._is_lost = self._is_lost, True
            self._release()
        if not again:
            self._pause_s = self._options.reconnect_s[0]
            _log.error("%s: lost: %s gives no frames; looking for it", self._name, self._options.device)

    def _look_again(self) -> None:
        if self._closing.wait(self._pause_s):
            return
        self._pause_s = min(2.0 * self._pause_s, self._options.reconnect_s[1])
        try:
            capture = open_camera(self._open_capture, self._options, self._name)
        except DeviceError as error:
            _log.debug("%s: not back yet: %s", self._name, error)
            return
        with self._lock:
            self.settings = apply(capture, self.settings, self._options)
            self._capture = capture

    def _note_return(self, away_s: float) -> None:
        """The first frame after a loss: by the rate so many are missing."""
        missing = max(round(away_s * self.settings.frame_rate_hz) - 1, 0)
        self._count.restart()
        self._count.skip(missing)
        if self._stream is not None and self._stream.begun:
            self._stream.inferred_missing += missing
        self._is_lost = False
        _log.warning("%s: back after %.1f s, about %d frames are missing", self._name, away_s, missing)

    def _release(self) -> None:
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.release()
