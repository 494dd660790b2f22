"""One camera from connect to close: its commands, its one polling thread, and finding it again when it is lost."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from drivers.cameras.aravis.acquisition import Acquisition
from drivers.cameras.aravis.counters import FrameGap, StreamCounters
from drivers.cameras.aravis.device import SNAP_BUFFERS, Device, Settings
from drivers.cameras.aravis.discovery import open_camera
from drivers.cameras.aravis.frame_ids import FrameCount
from drivers.cameras.aravis.options import AravisOptions
from drivers.cameras.aravis.streaming import Streaming, make_frame, middle_ns
from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceTimeoutError, NotConnectedError
from drivers.interfaces import CameraInfo, Frame, FrameStatus

POP_S = 0.05
"""Longest wait for a frame before the thread looks whether it is still wanted."""
IDLE_S = 0.2
CLOSE_TIMEOUT_S = 20.0

_log = logging.getLogger(__name__)


class Connection:
    """Opens the camera when made; safe to use from any thread.

    Raises what `open_camera` and `Device` raise.
    """

    def __init__(self, options: AravisOptions, name: str, clock: Clock, settings: Settings) -> None:
        self._options = options
        self._name = name
        self._clock = clock
        camera = open_camera(options, name, clock, patience_s=options.open_timeout_s)
        self._device: Device | None = Device(camera, options, name)
        self.info: CameraInfo = self._device.info
        self.settings = self._device.set(settings)
        self.streaming: Streaming | None = None
        self._count = FrameCount(wraps=self._device.is_gige)
        self._acquisition: Acquisition | None = None
        self._can_be_triggered = self._device.can_be_triggered()
        self._lock = threading.RLock()
        self._closing, self._wake = threading.Event(), threading.Event()
        self._pause_s = options.reconnect_s[0]
        self._last_frame_s = self._last_look_s = self._away_since_s = clock.now_s()
        self._lost_because = ""
        self._thread = threading.Thread(target=self._poll, name=f"{name}-frames", daemon=True)
        self._thread.start()

    @property
    def is_lost(self) -> bool:
        """Whether the camera is being looked for."""
        return self._device is None

    def lost_error(self, doing: str) -> NotConnectedError:
        """What a command raises while the camera is lost."""
        hint = "it is looked for; check its power and its cable"
        return NotConnectedError(self._name, f"{doing}: the camera is lost ({self._lost_because})", hint)

    @contextmanager
    def command(self, doing: str) -> Iterator[Device]:
        """The device, for one thread at a time. Raises `NotConnectedError` while it is lost."""
        with self._lock:
            device = self._device
            if device is None:
                raise self.lost_error(doing)
            yield device

    def set(self, settings: Settings) -> None:
        """Change the settings."""
        with self.command("changing its settings") as device:
            self.settings = device.set(settings)

    def snap(self, timeout_s: float) -> Frame:
        """One frame, triggered by command where the camera can; raises `DeviceTimeoutError`.

        A camera that falls silent meanwhile lets it take up to 10 s longer: Aravis's questions have to run out.
        """
        doing = "taking a frame"
        deadline_s = self._clock.now_s() + timeout_s
        with self.command(doing) as device:
            device.arm("software" if self._can_be_triggered else "off")
            device.answers()  # Aravis takes silence for a camera without streams
            if self._clock.now_s() > deadline_s:
                hint = "check the network (docs/drivers/aravis.md) and the cable"
                raise DeviceTimeoutError(self._name, f"{doing}: it did not answer within {timeout_s:g} s", hint)
            acquisition = device.start(SNAP_BUFFERS)
            self._count.begin()
            try:
                if self._can_be_triggered:
                    device.trigger()
                arrival = acquisition.pop(max(deadline_s - self._clock.now_s(), 0.0))
                host_time_ns = round(1e9 * self._clock.now_s())
            finally:
                device.stop(acquisition)
            if arrival is None:
                hint = "check exposure and time-out, the network (docs/drivers/aravis.md) and the cable"
                raise DeviceTimeoutError(self._name, f"{doing}: none came within {timeout_s:g} s", hint)
            frame_id, _ = self._count.count(arrival.raw_id)
            if arrival.image is None or arrival.camera_time_ns is None:
                hint = "see docs/drivers/aravis.md for MTU and net.core.rmem_max"
                raise DeviceTimeoutError(self._name, f"{doing}: packets of it were lost on the network", hint)
            time_ns = middle_ns(arrival.camera_time_ns, self.settings.exposure_s, self._options)
            return make_frame(arrival.image, frame_id, time_ns, host_time_ns, FrameStatus.OK)

    def start(self) -> None:
        """Begin to stream."""
        with self.command("starting the stream") as device:
            streaming = Streaming(self._options, self._count)
            self._begin(device)
            self.streaming = streaming
        self._wake.set()

    def stop(self) -> Streaming | None:
        """End the stream; returns it, None when there was none. Raises when the camera does not answer."""
        with self._lock:
            streaming, self.streaming = self.streaming, None
            acquisition, self._acquisition = self._acquisition, None
            if streaming is not None:
                streaming.queue.close()
            if acquisition is not None and self._device is not None:
                try:
                    self._device.stop(acquisition)
                finally:
                    if streaming is not None:
                        streaming.ended(acquisition.counters())
            return streaming

    def wire_counters(self) -> StreamCounters:
        """Aravis's counts of the acquisition that is under way."""
        acquisition = self._acquisition
        return StreamCounters() if acquisition is None else acquisition.counters()

    def close(self) -> None:
        """End the stream and the thread, and release the camera; may be called twice."""
        self._closing.set()
        self._wake.set()
        with suppress(DeviceError):
            self.stop()
        self._thread.join(CLOSE_TIMEOUT_S)
        with self._lock:
            device, self._device = self._device, None
            if device is not None:
                with suppress(DeviceError):
                    device.release()

    def _begin(self, device: Device) -> None:
        device.arm(self._options.trigger)
        device.answers()
        self._count.begin()
        self._acquisition = device.start(self._options.stream_buffers)
        self._last_frame_s = self._clock.now_s()

    def _poll(self) -> None:
        while not self._closing.is_set():
            if self.is_lost:
                self._look_again()
                continue
            acquisition, streaming = self._acquisition, self.streaming
            if acquisition is None or streaming is None:
                self._wake.wait(IDLE_S)
                self._wake.clear()
            elif (arrival := acquisition.pop(POP_S)) is not None:
                now_s = self._last_frame_s = self._clock.now_s()
                streaming.take(arrival, self.settings, round(1e9 * now_s))
            self._check()

    def _check(self) -> None:
        device = self._device
        if device is None:
            return
        if not device.is_ours():
            self._lose("its heartbeat ended: it is off, unplugged, or taken by another program")
        elif self._acquisition is None or self._options.trigger != "off":
            self._ask_at_rest(device)
        else:
            settings = self.settings
            patience_s = self._options.stall_timeout_s + settings.exposure_s + 2.0 / settings.frame_rate_hz
            if self._clock.now_s() - max(self._last_frame_s, self._last_look_s) > patience_s:
                self._look_into_a_stall(patience_s)

    def _ask_at_rest(self, device: Device) -> None:
        """USB3 Vision has no heartbeat, so a camera that owes no frame is asked now and then."""
        last_s = max(self._last_frame_s, self._last_look_s)
        if device.is_gige or self._clock.now_s() - last_s < self._options.stall_timeout_s:
            return
        try:
            with self.command("looking whether it is there") as device:
                device.answers()
                self._last_look_s = self._clock.now_s()
        except DeviceError:
            self._lose("it does not answer")

    def _look_into_a_stall(self, patience_s: float) -> None:
        try:
            with self.command("looking into a stalled stream") as device:
                device.answers()
        except DeviceError:
            self._lose(f"no frame for {patience_s:.1f} s and no answer")
        else:
            _log.warning("%s: it answers, but no frame came for %.1f s", self._name, patience_s)
            self._last_look_s = self._clock.now_s()

    def _lose(self, because: str) -> None:
        with self._lock:
            if self._closing.is_set():
                return
            self._device, self._lost_because = None, because
            acquisition, self._acquisition = self._acquisition, None
            owes_frames = acquisition is not None and self._options.trigger == "off"
            self._away_since_s = self._last_frame_s if owes_frames else self._clock.now_s()
            if acquisition is not None:
                acquisition.close()
                if self.streaming is not None:
                    self.streaming.ended(acquisition.counters())
        self._pause_s = self._options.reconnect_s[0]
        _log.error("%s: lost: %s; looking for it", self._name, because)

    def _look_again(self) -> None:
        if self._closing.wait(self._pause_s):
            return
        self._pause_s = min(2.0 * self._pause_s, self._options.reconnect_s[1])
        try:
            device = Device(
                open_camera(self._options, self._name, self._clock, patience_s=0.0), self._options, self._name
            )
            settings = device.set(self.settings)
            with self._lock:
                if self._closing.is_set():
                    return
                if self.streaming is not None:
                    self._begin(device)
                away_s = self._clock.now_s() - self._away_since_s
                if self.streaming is not None:
                    self._note_gap(self.streaming, away_s)
                self._device, self.settings = device, settings
        except DeviceError as error:
            _log.debug("%s: not back yet: %s", self._name, error)
            return
        _log.warning("%s: back after %.1f s, with its settings", self._name, away_s)

    def _note_gap(self, streaming: Streaming, away_s: float) -> None:
        """The frames that the rate would have given meanwhile are missing; a triggered camera tells of none."""
        missing = 0
        if self._options.trigger == "off":
            missing = max(round(away_s * self.settings.frame_rate_hz) - 1, 0)
        self._count.forget(missing)
        streaming.interrupted(FrameGap(self._count.next_id, missing, away_s))
