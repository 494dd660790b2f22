"""Track both views of a sequence on a pool of workers; the results are those of one process."""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Callable, Generator, Iterable
from dataclasses import replace
from types import TracebackType
from typing import Self, TypeVar

from bscd.dic.pool import Pool
from bscd.dic.tracker_state import Tracked, TrackerState
from bscd.procedures.measuring.beginning import Begun
from bscd.procedures.measuring.chain import ViewChain
from bscd.procedures.measuring.chunks import Chain
from bscd.procedures.measuring.held import HeldImages
from bscd.procedures.measuring.views import SIDES, FrameImages

Item = TypeVar("Item")

#: Frames in a task: enough that handing over the state costs little, few enough that little is done again.
CHUNK = 8

#: Chunks that are lent ahead of the one whose results are taken.
_AHEAD = 2


class PooledTracking:
    """The chains of both views; a context manager that ends them and gives all images back.

    ``chunk`` is how many frames a task may have (None: `CHUNK`); results do not depend on it.
    ``starts`` are the states to go on from, by default those after the reference; ``earlier`` are the images of the
    frames that they name, by number.
    """

    def __init__(
        self,
        pool: Pool,
        begun: Begun,
        *,
        chunk: int | None = None,
        starts: tuple[TrackerState, TrackerState] | None = None,
        earlier: dict[int, FrameImages] | None = None,
    ) -> None:
        self._chunk = chunk or CHUNK
        starts = starts or begun.sequence.starts()
        self._held = HeldImages(pool, begun.reference, starts)
        self._chains: list[ViewChain] = []
        try:
            for number, images in (earlier or {}).items():
                self._held.add(images, number)
            settings, name = replace(begun.sequence.tracking, threads=pool.threads), uuid.uuid4().hex
            for view, (side, start) in enumerate(zip(SIDES, starts, strict=True)):
                chain = Chain(f"{name} {side}", side, begun.source, settings)
                self._chains.append(ViewChain(pool, chain, start, self._held, self._chunk, self._reached(view)))
        except BaseException:
            self.close()
            raise

    def put(self, images: FrameImages) -> None:
        """Track the next frame; whoever puts sees to it that not too many wait."""
        number = self._held.add(images)
        for chain in self._chains:
            chain.put(number)

    def take(self) -> tuple[Tracked, Tracked]:
        """Left and right view of the next frame; raises what the workers could not do."""
        left, right = (chain.take() for chain in self._chains)
        return left, right

    def states(self) -> tuple[TrackerState, TrackerState]:
        """Where both views' trackers stand; after all results were taken, those after the last frame."""
        left, right = (chain.state for chain in self._chains)
        return left, right

    def follow(self, frames: Iterable[tuple[Item, FrameImages]]) -> Generator[tuple[Item, Tracked, Tracked]]:
        """What was tracked in frames, in their order; no more than three chunks are under way."""
        waiting: deque[Item] = deque()
        for item, images in frames:
            self.put(images)
            waiting.append(item)
            if len(waiting) >= (1 + _AHEAD) * self._chunk:
                yield waiting.popleft(), *self.take()
        while waiting:
            yield waiting.popleft(), *self.take()

    def close(self) -> None:
        """End the chains and give the images back."""
        for chain in self._chains:
            chain.close()
        self._held.close()

    def _reached(self, view: int) -> Callable[[TrackerState], None]:
        return lambda state: self._held.reached(view, state)

    def __enter__(self) -> Self:
        """The tracking, under way since it was made."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End it."""
        self.close()
