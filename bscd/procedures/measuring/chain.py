"""One view's chain of chunks on a pool: each goes on from the state that the one before left."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from bscd.dic.pool import Pool, PoolClosedError
from bscd.dic.pool.interface import TASK_TIMEOUT_S
from bscd.dic.tracker_state import Tracked, TrackerState
from bscd.procedures.measuring.chunks import Chain, Resume, track_chunk
from bscd.procedures.measuring.held import HeldImages

#: How often who waits looks whether all has ended; a task may be tried twice.
_LOOK_S = 0.2
_RESULT_S = 2.5 * TASK_TIMEOUT_S


class ViewChain:
    """Tracks the frames of ``held`` that are named by `put`, up to ``chunk`` of those that wait in one task.

    ``reached`` is called with each new ``state`` before the results that led to it can be taken.
    """

    def __init__(
        self,
        pool: Pool,
        chain: Chain,
        start: TrackerState,
        held: HeldImages,
        chunk: int,
        reached: Callable[[TrackerState], None],
    ) -> None:
        self._pool, self._chain, self._held, self._chunk = pool, chain, held, chunk
        self.state, self._reached = start, reached
        self._numbers: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[Tracked | BaseException] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._known = False
        self._thread = threading.Thread(target=self._run, name=f"{chain.side} view", daemon=True)
        self._thread.start()

    def put(self, number: int) -> None:
        """Track the next frame when its turn comes."""
        self._numbers.put(number)

    def take(self) -> Tracked:
        """The next frame's result, when it is there; raises what the workers could not do."""
        waited_s = 0.0
        while not self._closing.is_set():
            with suppress(queue.Empty):
                result = self._results.get(timeout=_LOOK_S)
                if isinstance(result, BaseException):
                    raise result
                return result
            waited_s += _LOOK_S
            if waited_s > _RESULT_S:
                raise TimeoutError(f"{self._chain.side} view: no result in {_RESULT_S:.0f} s")
        raise PoolClosedError("tracking was ended before its results were taken")

    def close(self) -> None:
        """End it; what was not tracked is not."""
        self._closing.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            while not self._closing.is_set():
                with suppress(queue.Empty):
                    self._track(self._numbers.get(timeout=_LOOK_S))
        except BaseException as error:  # raised where the result is taken
            self._results.put(error)

    def _track(self, first: int) -> None:
        numbers = [first]
        while len(numbers) < self._chunk:
            try:
                numbers.append(self._numbers.get_nowait())
            except queue.Empty:
                break
        frames = list(self._held.frames(numbers).values())
        done = self._asked(frames, None) if self._known else None
        if done is None:
            done = self._asked(frames, Resume(self.state, self._held.frames(self.state.images)))
        found, self.state = done
        self._known = True
        self._reached(self.state)
        for tracked in found:
            self._results.put(tracked)

    def _asked(self, frames: list[Any], resume: Resume | None) -> Any:
        future = self._pool.submit(track_chunk, self._chain, self.state.tracked, frames, resume, near=self._chain.name)
        waited_s = 0.0
        while True:
            try:
                return future.result(_LOOK_S)
            except TimeoutError:
                if future.done():
                    raise  # the work's own
                waited_s += _LOOK_S
            if self._closing.is_set() or waited_s > _RESULT_S:
                future.cancel()
                raise PoolClosedError(f"{self._chain.side} view: given up after {waited_s:.0f} s")
