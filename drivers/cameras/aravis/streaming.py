"""What a stream knows from `Camera.start` to `Camera.stop`, also over a lost camera that came back."""

from __future__ import annotations

import threading
from dataclasses import replace

from drivers.cameras.aravis.acquisition import Arrival
from drivers.cameras.aravis.counters import FrameGap, StreamCounters
from drivers.cameras.aravis.device import Settings
from drivers.cameras.aravis.frame_ids import FrameCount
from drivers.cameras.aravis.options import AravisOptions
from drivers.cameras.aravis.pixels import Grey
from drivers.cameras.frame_queue import FrameQueue
from drivers.interfaces import Frame, FrameStatus


class Streaming:
    """Turns arrivals into frames for the reader and counts what is lost; one thread calls `take`."""

    def __init__(self, options: AravisOptions, count: FrameCount) -> None:
        self.queue = FrameQueue(options.buffer_frames)
        self._options = options
        self._count = count
        self._lock = threading.Lock()
        self._incomplete = self._missing = self._delivered_parts = 0
        self._gaps: list[FrameGap] = []
        self._before = StreamCounters()
        self._last_times_ns: tuple[int, int] | None = None

    def take(self, arrival: Arrival, settings: Settings, host_time_ns: int) -> None:
        """Count a buffer, and hand its frame to the reader when it may have it."""
        frame_id, missing = self._count.count(arrival.raw_id)
        time_ns = self._camera_time_ns(arrival, settings, host_time_ns)
        image, status = arrival.image, FrameStatus.OK
        if image is None:
            image, status = None if time_ns is None else arrival.part, FrameStatus.INCOMPLETE
        with self._lock:
            self._missing += missing
            if status is FrameStatus.INCOMPLETE:
                self._incomplete += 1
                self._delivered_parts += image is not None
        if image is not None and time_ns is not None:
            middle = middle_ns(time_ns, settings.exposure_s, self._options)
            self.queue.put(make_frame(image, frame_id, middle, host_time_ns, status))

    def interrupted(self, gap: FrameGap) -> None:
        """A camera came back: note the frames that were not made."""
        self._last_times_ns = None
        with self._lock:
            self._missing += gap.missing
            self._gaps.append(gap)

    def ended(self, counters: StreamCounters) -> None:
        """An acquisition ended, with these counts of Aravis."""
        with self._lock:
            self._before += counters

    def gaps(self) -> tuple[FrameGap, ...]:
        """The times without a camera."""
        with self._lock:
            return tuple(self._gaps)

    def counts(self) -> tuple[int, int]:
        """Frames delivered to the reader, and frames lost."""
        delivered, overrun = self.queue.counts()
        with self._lock:
            return delivered, overrun + self._missing + self._incomplete - self._delivered_parts

    def counters(self, now: StreamCounters) -> StreamCounters:
        """Every stage; ``now`` are the counts of Aravis of the acquisition that is under way."""
        delivered, overrun = self.queue.counts()
        with self._lock:
            total = self._before + now
            return replace(
                total, incomplete=self._incomplete, missing=self._missing, overrun=overrun, delivered=delivered
            )

    def _camera_time_ns(self, arrival: Arrival, settings: Settings, host_time_ns: int) -> int | None:
        """The camera's time of a frame; where it was lost, one period after the frame before, None before the first.

        Of a triggered camera it is the host's time then, laid on the camera's clock by the frame before.
        """
        time_ns = arrival.camera_time_ns
        if time_ns is None:
            if self._last_times_ns is None:
                return None
            last_ns, last_host_ns = self._last_times_ns
            free_running = self._options.trigger == "off"
            time_ns = last_ns + (round(1e9 / settings.frame_rate_hz) if free_running else host_time_ns - last_host_ns)
        self._last_times_ns = time_ns, host_time_ns
        return time_ns


def middle_ns(time_ns: int, exposure_s: float, options: AravisOptions) -> int:
    """The middle of an exposure whose camera stamped it with ``time_ns``."""
    halves = {"start": 1, "middle": 0, "end": -1}[options.time_stamp_at]
    return time_ns + halves * round(5e8 * exposure_s)


def make_frame(image: Grey, frame_id: int, camera_time_ns: int, host_time_ns: int, status: FrameStatus) -> Frame:
    """The frame of an image."""
    return Frame(image, frame_id, camera_time_ns=camera_time_ns, host_time_ns=host_time_ns, status=status)
