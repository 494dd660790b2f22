"""What became of a call that was made while another one was under way."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from drivers.clock import Clock


class Outcome:
    """Makes a call in a thread of its own, `delay_s` from now, and keeps what it returned or raised."""

    def __init__(self, clock: Clock, delay_s: float, call: Callable[[], Any]) -> None:
        self._call = call
        self._done = threading.Event()
        self._value: Any = None
        self._error: Exception | None = None
        clock.call_at(clock.now_s() + delay_s, self._in_a_thread)

    def _in_a_thread(self) -> None:
        thread = threading.Thread(target=self._run)
        thread.start()
        thread.join(timeout=30)

    def _run(self) -> None:
        try:
            self._value = self._call()
        except Exception as error:
            self._error = error
        self._done.set()

    def get(self) -> Any:
        """The returned value; raises what the call raised, or AssertionError when it was never made."""
        assert self._done.wait(timeout=10), "the call was never made or did not return"
        if self._error is not None:
            raise self._error
        return self._value


def all_at_once(call: Callable[[], Any], threads: int = 8) -> None:
    """Make a call from several threads at the same time; raise the first error."""
    gate = threading.Barrier(threads)
    errors: list[Exception] = []

    def run() -> None:
        gate.wait(timeout=10)
        try:
            call()
        except Exception as error:
            errors.append(error)

    crowd = [threading.Thread(target=run) for _ in range(threads)]
    for thread in crowd:
        thread.start()
    for thread in crowd:
        thread.join(timeout=30)
    assert not any(thread.is_alive() for thread in crowd), "a call did not return"
    if errors:
        raise errors[0]
