"""What a pool of workers promises, whichever it is."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from types import TracebackType
from typing import Any, Protocol, Self, TypeVar

from numpy.typing import NDArray

from bscd.errors import BscdError

Result = TypeVar("Result")

#: How long a task may take, and how long to wait for room, before the pool gives up on its worker.
TASK_TIMEOUT_S = 300.0


class WorkerLostError(BscdError):
    """A task's worker was lost, and so was the one that tried again; see the system's log for why they died."""


class PoolClosedError(BscdError):
    """The pool was closed before the task was done."""


class LentImage(Protocol):
    """An image that tasks may read, in whatever process they run; it is pickled without its pixels where it can be."""

    def read(self) -> NDArray[Any]:
        """An own copy of the pixels."""
        ...

    def release(self) -> None:
        """Give back what holds it, by the process that lent it; no task may read it afterwards."""
        ...


class Pool(Protocol):
    """Workers for functions of modules, with arguments that can be pickled. A context manager, which closes it.

    A worker that is lost costs time, not data: its task is tried once more. ``threads`` is how many a task should use.
    """

    threads: int

    def lend(self, image: NDArray[Any]) -> LentImage:
        """Make an image ``(H, W)`` readable for tasks."""
        ...

    def submit(self, work: Callable[..., Result], *arguments: Any, near: str) -> Future[Result]:
        """Have ``work(*arguments)`` done; tasks of one ``near`` go to the same worker where that is possible.

        Waits while that worker has enough to do. The future raises what the work raised, `WorkerLostError` or
        `PoolClosedError`; it can be cancelled until a worker has it.
        """
        ...

    def close(self) -> None:
        """End all workers; tasks that are not done fail with `PoolClosedError`."""
        ...

    def __enter__(self) -> Self:
        """The pool itself."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        ...
