"""Worker processes of this computer: images in shared memory, kernels on each process's own threads."""

from __future__ import annotations

import queue
import subprocess
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pickle import HIGHEST_PROTOCOL, dumps, loads
from types import TracebackType
from typing import Any, Self

from numpy.typing import NDArray

from bscd.dic.pool.interface import TASK_TIMEOUT_S, PoolClosedError, Result, WorkerLostError
from bscd.dic.pool.program import end_program, start_program
from bscd.dic.pool.shared import SharedImage
from bscd.dic.solver import usable_cores
from bscd.errors import InputError

#: Tasks that may wait at a worker.
_WAITING = 2

#: A worker is looked at so often while it works; one that does not end by itself is killed.
_LOOK_S = 0.2
_GRACE_S = 0.5


@dataclass(frozen=True)
class _Task:
    pickled: bytes
    future: Future[Any] = field(default_factory=Future)


class LocalPool:
    """``workers`` processes; one that dies is started again, and its task tried once more.

    ``threads`` of each worker's kernels (None: the cores divided among them); ``nice`` lowers their priority;
    ``task_timeout_s`` after which a worker counts as lost. ``restarts`` counts those that were started again.
    """

    def __init__(
        self, workers: int, *, threads: int | None = None, nice: int = 0, task_timeout_s: float = TASK_TIMEOUT_S
    ) -> None:
        if workers < 1:
            raise InputError(f"workers: is {workers}, at least 1 is needed")
        self.threads = threads or max(usable_cores() // workers, 1)
        self._closing = threading.Event()
        self._near: dict[str, _Worker] = {}
        self._lock = threading.Lock()
        self._workers = [_Worker(self.threads, nice, task_timeout_s, self._closing) for _ in range(workers)]

    @property
    def restarts(self) -> int:
        """How many workers died and were started again."""
        return sum(worker.restarts for worker in self._workers)

    @property
    def process_ids(self) -> list[int]:
        """Of the workers, as they run now."""
        return [worker.process_id for worker in self._workers]

    def lend(self, image: NDArray[Any]) -> SharedImage:
        """Copy an image into shared memory."""
        return SharedImage.holding(image)

    def submit(self, work: Callable[..., Result], *arguments: Any, near: str) -> Future[Result]:
        """Have a task done by the worker of ``near``; waits while two tasks are waiting there."""
        task = _Task(dumps((work, arguments), HIGHEST_PROTOCOL))
        self._worker(near).put(task)
        return task.future

    def close(self) -> None:
        """End the workers; what they had not done fails."""
        self._closing.set()
        for worker in self._workers:
            worker.join()

    def _worker(self, near: str) -> _Worker:
        with self._lock:
            if near not in self._near:
                load = Counter(self._near.values())
                self._near[near] = min(self._workers, key=lambda worker: load[worker])
            return self._near[near]

    def __enter__(self) -> Self:
        """The pool; its workers run since it was made."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()


class _Worker:
    """A process, started again when it dies, and the thread that hands it its tasks."""

    def __init__(self, threads: int, nice: int, timeout_s: float, closing: threading.Event) -> None:
        self._settings = (threads, nice)
        self._timeout_s, self._closing = timeout_s, closing
        self._tasks: queue.Queue[_Task] = queue.Queue(_WAITING)
        self.restarts = 0
        self._process, self._pipe = self._started()
        self._thread = threading.Thread(target=self._run, name="pool", daemon=True)
        self._thread.start()

    @property
    def process_id(self) -> int:
        """Of the process as it runs now."""
        return self._process.pid

    def put(self, task: _Task) -> None:
        waited_s = 0.0
        while not self._closing.is_set():
            with suppress(queue.Full):
                self._tasks.put(task, timeout=_LOOK_S)
                return
            waited_s += _LOOK_S
            if waited_s > 2.0 * (_WAITING + 1) * self._timeout_s:
                raise WorkerLostError("the pool: a worker takes no more tasks; start again with fewer points or frames")
        raise PoolClosedError("the pool was closed; no more tasks are taken")

    def join(self) -> None:
        self._thread.join()

    def _started(self) -> tuple[subprocess.Popen[bytes], Connection]:
        return start_program("bscd.dic.pool.worker", *self._settings)

    def _run(self) -> None:
        while not self._closing.is_set():
            with suppress(queue.Empty):
                self._do(self._tasks.get(timeout=_LOOK_S))
        while True:
            try:
                _settle(self._tasks.get_nowait().future, error=PoolClosedError("the pool was closed"))
            except queue.Empty:
                break
        self._end()

    def _do(self, task: _Task) -> None:
        if not task.future.set_running_or_notify_cancel():
            return
        for _ in range(2):
            try:
                done, value = loads(self._asked(task.pickled))  # noqa: S301 - from a process that we started
            except (EOFError, OSError):
                self._end()
                self._process, self._pipe = self._started()
                self.restarts += 1
                continue
            except PoolClosedError as error:
                _settle(task.future, error=error)
                return
            _settle(task.future, value=value if done else None, error=None if done else value)
            return
        _settle(task.future, error=WorkerLostError("the pool: two workers in turn died over one task, see the log"))

    def _asked(self, task: bytes) -> bytes:
        self._pipe.send_bytes(task)
        waited_s = 0.0
        while not self._pipe.poll(_LOOK_S):
            waited_s += _LOOK_S
            if self._closing.is_set():
                raise PoolClosedError("the pool was closed before the task was done")
            if waited_s > self._timeout_s:
                raise TimeoutError("no answer")  # an OSError: the worker counts as lost
        return self._pipe.recv_bytes()

    def _end(self) -> None:
        end_program(self._process, self._pipe, _GRACE_S)


def _settle(future: Future[Any], *, value: Any = None, error: BaseException | None = None) -> None:
    with suppress(InvalidStateError):  # it was cancelled
        if error is None:
            future.set_result(value)
        else:
            future.set_exception(error)
