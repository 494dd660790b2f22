"""The ring: preallocated buffers in shared memory between one source of frames and its consumers."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import DTypeLike

from bscd.acquisition.records import FrameRecord
from bscd.acquisition.stream.subscription import ConsumerCounts, FrameLease, Keep, Subscription
from bscd.errors import BscdError
from bscd.shared_frames import SharedBuffers

#: Share of the buffers in use from which the ring counts as filling up.
ALARM_SHARE = 0.75

#: Buffers that bounded consumers leave to the recorder at least.
_RECORDER_SLOTS = 4


class FrameRing:
    """Buffers between a source and its consumers; a context manager that frees them.

    The source publishes and never waits: where no buffer is free the frame is refused, which the source counts as a
    loss. A buffer is free again when every consumer that got its frame has released it. Consumers subscribe before
    the first frame; those that may fall behind hold a bounded number of buffers, so only the recorder can fill the
    ring. Safe to use from any thread.

    Parameters
    ----------
    shape, dtype
        Height and width (px) and type of the frames.
    slots
        How many frames fit; the memory is taken at once.
    """

    def __init__(self, shape: tuple[int, int], dtype: DTypeLike, slots: int = 64) -> None:
        self._buffers = SharedBuffers(slots, shape, dtype)
        self.slots = slots
        self._changed = threading.Condition(threading.RLock())
        self._free = deque(range(slots))
        self._users = [0] * slots
        self._subscriptions: list[Subscription] = []
        self._peak = self._published = self._refused = 0
        self._closed = False

    @property
    def fill(self) -> int:
        """Buffers in use."""
        with self._changed:
            return self.slots - len(self._free)

    @property
    def peak_fill(self) -> int:
        """The most buffers that were ever in use at once."""
        with self._changed:
            return self._peak

    @property
    def filling_up(self) -> bool:
        """Whether so many buffers are in use that frames will soon be lost."""
        return self.fill >= ALARM_SHARE * self.slots

    @property
    def counts(self) -> tuple[int, int]:
        """Frames published, and refused because no buffer was free."""
        with self._changed:
            return self._published, self._refused

    def counts_of(self, name: str) -> ConsumerCounts | None:
        """What a consumer was offered and took; None when there is none of that name."""
        with self._changed:
            return next((one.counts() for one in self._subscriptions if one.name == name), None)

    def subscribe(self, name: str, keep: Keep, depth: int = 1) -> Subscription:
        """Add a consumer that holds ``depth`` buffers at most (with `Keep.ALL` as many as there are).

        Raises `BscdError` when the bounded consumers would leave too few for the recorder.
        """
        with self._changed:
            bounded = sum(one.depth for one in self._subscriptions if one.keep is not Keep.ALL)
            if keep is not Keep.ALL and bounded + depth > self.slots - _RECORDER_SLOTS:
                raise BscdError(
                    f"{name}: {depth} buffers do not fit beside {bounded} others in a ring of {self.slots}; "
                    "make it larger"
                )
            subscription = Subscription(name, keep, depth, self._changed)
            self._subscriptions.append(subscription)
            return subscription

    def publish(self, number: int, record: FrameRecord) -> bool:
        """Copy a frame in and hand it to the consumers; False, at once, when no buffer is free."""
        with self._changed:
            if self._closed:
                raise BscdError("the ring is closed; no more frames can be published")
            if not self._free:
                self._refused += 1
                return False
            slot = self._free.popleft()
            self._users[slot] = 1  # the source's own, while it fills the buffer
            self._peak = max(self._peak, self.slots - len(self._free))
        image = self._buffers.view(slot)
        np.copyto(image, record.data, casting="no")
        seen = image.view()
        seen.flags.writeable = False
        shared = replace(record, data=seen)
        with self._changed:
            self._published += 1
            for one in self._subscriptions:
                one.offer(number, partial(self._lease, slot, number, shared, one))
            self._changed.notify_all()
        self._release(slot)
        return True

    def end(self) -> None:
        """No more frames; consumers take what waits. Does nothing when ended."""
        with self._changed:
            self._closed = True
            for one in self._subscriptions:
                one.end()
            self._changed.notify_all()

    def close(self) -> None:
        """End, drop what still waits and free the memory; views of released frames stay readable, not valid."""
        self.end()
        for one in self._subscriptions:
            one.close()
        self._buffers.close()

    def __enter__(self) -> FrameRing:
        """The ring itself."""
        return self

    def __exit__(self, *ended: object) -> None:
        """Free the memory."""
        self.close()

    def _lease(self, slot: int, number: int, record: FrameRecord, by: Subscription) -> FrameLease:
        self._users[slot] += 1

        def release() -> None:
            with self._changed:
                by.given_back()
            self._release(slot)

        return FrameLease(number, record, self._buffers.handle(slot, number), release)

    def _release(self, slot: int) -> None:
        with self._changed:
            self._users[slot] -= 1
            if not self._users[slot]:
                self._free.append(slot)
