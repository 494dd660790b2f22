"""Rendered frames kept by world state, in bounded memory, and rendered ahead by one thread."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

from drivers.twin.sensor import FloatImage

Key = TypeVar("Key", bound=Hashable)


class FrameStore(Generic[Key]):
    """Renders each key once; the least recently used frames go when memory runs out.

    ``render`` is called with a key, from any thread.
    """

    def __init__(self, render: Callable[[Key], FloatImage], memory_bytes: int) -> None:
        self._render = render
        self._memory_bytes = memory_bytes
        self._frames: OrderedDict[Key, FloatImage] = OrderedDict()
        self._queued: dict[Key, Future[FloatImage]] = {}
        self._lock = threading.Lock()
        self._ahead: ThreadPoolExecutor | None = None

    def __len__(self) -> int:
        """How many frames are kept."""
        with self._lock:
            return len(self._frames)

    def get(self, key: Key) -> FloatImage:
        """The frame of a key, read-only: kept, under way in the background, or rendered now."""
        with self._lock:
            frame = self._kept(key)
            queued = None if frame is not None else self._queued.get(key)
            if frame is None and (queued is None or queued.cancel()):
                self._queued.pop(key, None)
                queued = None
        if frame is not None:
            return frame
        return self._render_and_keep(key) if queued is None else queued.result()

    def prepare(self, keys: Iterable[Key]) -> None:
        """Render in the background what is not kept yet, in this order; returns at once."""
        with self._lock:
            for key in keys:
                if self._kept(key) is not None or key in self._queued:
                    continue
                if self._ahead is None:
                    self._ahead = ThreadPoolExecutor(1, thread_name_prefix="twin-render")
                self._queued[key] = self._ahead.submit(self._render_and_keep, key)

    def wait(self) -> None:
        """Return when everything that was prepared is rendered; raises what a rendering raised."""
        with self._lock:
            queued = list(self._queued.values())
        for future in queued:
            if not future.cancelled():
                future.result()

    def close(self) -> None:
        """Drop what is queued, finish what is under way, end the thread and forget the frames."""
        with self._lock:
            ahead, self._ahead = self._ahead, None
            self._queued, queued = {}, self._queued
        for future in queued.values():
            future.cancel()
        if ahead is not None:
            ahead.shutdown(wait=True, cancel_futures=True)
        with self._lock:
            self._frames.clear()

    def _kept(self, key: Key) -> FloatImage | None:
        frame = self._frames.get(key)
        if frame is not None:
            self._frames.move_to_end(key)
        return frame

    def _render_and_keep(self, key: Key) -> FloatImage:
        try:
            frame = self._render(key)
        except BaseException:
            with self._lock:
                self._queued.pop(key, None)
            raise
        frame.setflags(write=False)
        with self._lock:
            self._queued.pop(key, None)
            self._frames[key] = frame
            while len(self._frames) > 1 and sum(f.nbytes for f in self._frames.values()) > self._memory_bytes:
                self._frames.popitem(last=False)
        return frame
