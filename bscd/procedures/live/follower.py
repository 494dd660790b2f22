"""Between a recording's ring and its live measurement: takes frames in order, and counts what it leaves out."""

from __future__ import annotations

import threading

from bscd.acquisition import FrameRecord
from bscd.acquisition.stream import ConsumerCounts, FrameRing, Keep, Subscription
from bscd.errors import BscdError
from bscd.procedures.live.measurement import LiveMeasurement
from drivers.interfaces import FrameStatus

#: Buffers of the ring that may wait for the copy into the live process's memory.
_DEPTH = 8

_SLICE_S = 0.2
_JOIN_S = 10.0


class LiveFollower:
    """Hands the frames of a recording on to a `LiveMeasurement`; see `bscd.acquisition.stream.Follower`.

    A frame that could not be handed over in time is left out and counted; `LiveMeasurement.finish` measures it from
    the run file. ``counts`` are of the ring's side, `LiveMeasurement.missed` of the other one.
    """

    name = "live measurement"

    def __init__(self, live: LiveMeasurement) -> None:
        self._live = live
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
                record = lease.record
                if record.status is FrameStatus.OK:  # others are recorded, and never measured
                    left_out = sum(one < lease.number for one in subscription.left_out)
                    self._push(number + left_out, record)
                    number += 1

    def _push(self, number: int, record: FrameRecord) -> None:
        pressure_kpa = float("nan") if record.pressure_kpa is None else record.pressure_kpa
        exposure_ns = round((record.exposure_s or 0.0) * 0.5e9)
        self._live.push(number, record.data, record.time_s, pressure_kpa, exposed_ns=record.host_time_ns - exposure_ns)
