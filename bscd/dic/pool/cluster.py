"""Workers of a Dask cluster, for more runs than one computer can measure; images travel with the tasks."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, InvalidStateError
from contextlib import suppress
from pickle import HIGHEST_PROTOCOL, dumps, loads
from types import TracebackType
from typing import Any, Self

from numpy.typing import NDArray

from bscd.dic.pool.interface import TASK_TIMEOUT_S, PoolClosedError, Result, WorkerLostError
from bscd.dic.pool.shared import OwnImage
from bscd.errors import InputError
from bscd.version import __version__

#: Tasks of one ``near`` that are with the scheduler at a time.
_WAITING = 3

_CONNECT_S = 10.0
_LOOK_S = 0.2


class DaskPool:
    """The workers of the scheduler at an address (``tcp://host:8786``); a task uses one thread of its worker.

    A worker that is lost has its tasks done by another; the scheduler gives up on a task that cost it four workers.
    While no worker is left tasks wait for one; give up by a time-out on the future.
    Raises `InputError` where there is no such scheduler, it has no workers, or these have another version of bscd.
    """

    threads = 1

    def __init__(self, address: str, *, task_timeout_s: float = TASK_TIMEOUT_S) -> None:
        try:
            from dask import config
            from distributed import Client
        except ImportError as error:
            raise InputError("a Dask pool needs the extra cluster; run: pip install 'bscd[cluster]'") from error
        # a chunk of frames is meant to travel with its task: so the scheduler has it when a worker is lost
        config.set({"distributed.admin.large-graph-warning-threshold": "10GB"})
        _check_address(address)
        try:
            self._client: Any = Client(address, timeout=_CONNECT_S, set_as_default=False, name="bscd")
        except (OSError, ValueError) as error:
            raise InputError(f"{address}: no Dask scheduler answers there ({error}); is it running?") from error
        self._timeout_s = task_timeout_s
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self._room: dict[str, threading.Semaphore] = defaultdict(lambda: threading.Semaphore(_WAITING))
        self._last_at: dict[str, str] = {}
        self._open: dict[Future[Any], Any] = {}
        try:
            self._check_workers(address)
        except BaseException:
            self.close()
            raise

    def lend(self, image: NDArray[Any]) -> OwnImage:
        """The image itself; it travels with the tasks that name it."""
        return OwnImage(image)

    def submit(self, work: Callable[..., Result], *arguments: Any, near: str) -> Future[Result]:
        """Have a task done, where the last one of ``near`` was done if that worker lives; waits for room."""
        with self._lock:
            room, last = self._room[near], self._last_at.get(near)
        waited_s = 0.0
        while not room.acquire(timeout=_LOOK_S):
            waited_s += _LOOK_S
            if self._closing.is_set():
                break
            if waited_s > self._timeout_s:
                raise WorkerLostError("the Dask cluster takes no more tasks; look at its dashboard")
        if self._closing.is_set():
            raise PoolClosedError("the pool was closed; no more tasks are taken")
        sent = self._client.submit(
            _done,
            dumps((work, arguments), HIGHEST_PROTOCOL),
            pure=False,
            workers=[last] if last else None,
            allow_other_workers=bool(last),
        )
        future: Future[Result] = Future()
        with self._lock:
            self._open[future] = sent
        future.add_done_callback(lambda done: sent.cancel() if done.cancelled() else None)
        sent.add_done_callback(lambda _: self._take(near, sent, future))
        return future

    def close(self) -> None:
        """Leave the cluster; tasks that are not done are called off there, and fail here."""
        self._closing.set()
        with self._lock:
            left = dict(self._open)
        for future in left:  # before they are called off: else that would count as lost
            with suppress(InvalidStateError):
                future.set_exception(PoolClosedError("the pool was closed before the task was done"))
        if left:
            self._client.cancel(list(left.values()))
        self._client.close(timeout=_CONNECT_S)

    def _take(self, near: str, sent: Any, future: Future[Any]) -> None:
        """Hand on what a task gave, on a thread of the client's own."""
        try:
            told = sent.result(timeout=self._timeout_s)
        except CancelledError as error:
            told, failure = None, _lost(error)
        except Exception as error:
            told, failure = None, _lost(error) if type(error).__module__.startswith("distributed") else error
        else:
            failure = None
        with self._lock:
            self._open.pop(future, None)
            if told is not None:
                self._last_at[near] = told[0]
            self._room[near].release()
        with suppress(InvalidStateError):  # it was cancelled, or the pool closed
            if told is None:
                future.set_exception(failure)
            else:
                future.set_result(loads(told[1]))  # noqa: S301 - from the cluster that we chose to trust

    def _check_workers(self, address: str) -> None:
        versions = self._client.run(_version)
        if not versions:
            raise InputError(f"{address}: the scheduler has no workers; start one: dask worker {address}")
        for worker, version in versions.items():
            if version != __version__:
                raise InputError(f"{address}: worker {worker} has bscd {version}, not {__version__}; install the same")

    def __enter__(self) -> Self:
        """The pool, connected since it was made."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()


def _check_address(address: str) -> None:
    """Raise `InputError` for what is no address: the client that is refused one so can not be closed."""
    from distributed.comm.addressing import get_address_host_port

    try:
        port = get_address_host_port(address)[1]
    except (ValueError, RuntimeError) as error:
        raise InputError(
            f"{address}: no Dask scheduler answers there ({error}); give its address, tcp://host:8786"
        ) from error
    if not 0 < port < 65536:
        raise InputError(f"{address}: no Dask scheduler answers there (port {port}); give its address, tcp://host:8786")


def _lost(error: BaseException) -> WorkerLostError:
    return WorkerLostError(f"the Dask cluster lost a task ({type(error).__name__}: {error}); see its workers' logs")


def _done(task: bytes) -> tuple[str, bytes]:
    """On the worker: its address, and the result pickled."""
    from distributed import get_worker

    work, arguments = loads(task)  # noqa: S301 - whoever may reach a Dask scheduler may run anything there
    return get_worker().address, dumps(work(*arguments), HIGHEST_PROTOCOL)


def _version() -> str:
    from bscd.version import __version__ as theirs

    return theirs
