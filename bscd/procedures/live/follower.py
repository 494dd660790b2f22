"""Between a recording's ring and its live measurement: takes frames in order, and counts what it leaves out."""

from __future__ import annotations

import threading
from collections import deque

from bscd.acquisition import FrameRecord
from bscd.acquisition.stream import ConsumerCounts, FrameRing, Keep, Subscription
from bscd.errors import BscdError
from bscd.procedures.live.measurement import LiveMeasurement
from drivers.interfaces import FrameStatus

#: Buffers of the ring that may wait for the copy into the live process's memory.
_DEPTH = 8

_SLICE_S = 0.2
_JOIN_S = 10.0

#: Frames over which the shortest way from camera to host is sought.
_WINDOW = 256


class LiveFollower:
    """Hands the frames of a recording on to a `LiveMeasurement`; see `bscd.acquisition.stream.Follower`.

    A frame that could not be handed over in time is left out and counted; `LiveMeasurement.finish` measures it from
    the run file. ``counts`` are of the ring's side, `LiveMeasurement.missed` of the other one. ``readout_s`` is the
    time from the end of an exposure until its frame can be here.
    """

    name = "live measurement"

    def __init__(self, live: LiveMeasurement, readout_s: float = 0.0) -> None:
        self._live = live
        self._readout_s = readout_s
        self._ways_ns: deque[int] = deque(maxlen=_WINDOW)
        self._subscription: Subscription | None = None
        self._thread = threading.Thread(target=self._run, name="live follower", daemon=True)

    def counts(self) -> ConsumerCounts:
        """What the ring offered and what became of it; zeros before it began."""
        return ConsumerCounts(0, 0, 0, 0) if self._subscription is None else self._subscription.counts()

    def begin(self, ring: FrameRing) -> None:
        """Subscribe and start."""
        self._subscription = ring.subscribe(self.name, Keep.FIRST, _DEPTH)
        self._thread.start()

    def end(self) -> None:
        """Hand over what still waits, and join."""
        self._thread.join(_JOIN_S)
        if self._thread.is_alive():
            raise BscdError(f"it was still handing over frames after {_JOIN_S:g} s")

    def _run(self) -> None:
        subscription = self._subscription
        assert subscription is not None  # noqa: S101 - begun
        number = 0
        while not subscription.ended:
            lease = subscription.take(_SLICE_S)
            if lease is None:
                continue
            with lease:
                left_out = sum(one < lease.number for one in subscription.left_out)
                if lease.record.status is FrameStatus.OK:
                    self._push(number + left_out, lease.record)
                else:
                    self._live.skip(number + left_out)
                number += 1

    def _push(self, number: int, record: FrameRecord) -> None:
        pressure_kpa = float("nan") if record.pressure_kpa is None else record.pressure_kpa
        self._live.push(number, record.data, record.time_s, pressure_kpa, exposed_ns=self._exposed_ns(record))

    def _exposed_ns(self, record: FrameRecord) -> int:
        """The host's time at the middle of an exposure.

        Times of frames are the camera's; the shortest delay of many is taken for exposure and readout alone.
        """
        time_ns = round(record.time_s * 1e9)
        self._ways_ns.append(record.host_time_ns - time_ns)
        return time_ns + min(self._ways_ns) - round((record.exposure_s / 2.0 + self._readout_s) * 1e9)
