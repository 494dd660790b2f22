"""Let the stages of a sequence overlap, each on a thread of its own, one item ahead of the stage that takes from it."""

from __future__ import annotations

import threading
from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

Item = TypeVar("Item")

_END: Any = object()


def one_ahead(items: Iterator[Item]) -> Generator[Item]:
    """The items in their order; the next one is made on a thread of its own while one is worked on.

    What fails there is raised where the item would have been taken. No more than one item waits; leaving early waits
    until it is made.
    """
    with ThreadPoolExecutor(1, thread_name_prefix="ahead") as pool:
        coming = pool.submit(next, items, _END)
        while (item := coming.result()) is not _END:
            coming = pool.submit(next, items, _END)
            yield item


_lock = threading.Lock()
_users: list[threadpool_limits] = []


@contextmanager
def plain_linear_algebra() -> Iterator[None]:
    """Within it the linear algebra libraries start no threads; for the whole process, until the last one leaves.

    Their threads wait for one another by spinning, 8 ms for a product of some thousand rows, on the cores that the
    correlator's threads need.
    """
    with _lock:
        _users.append(threadpool_limits(1) if not _users else _users[0])
    try:
        yield
    finally:
        with _lock:
            limits = _users.pop()
            if not _users:
                limits.restore_original_limits()
