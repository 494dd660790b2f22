"""Signals that end a program, kept from ending it while a membrane may be under pressure."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, a request to end, and a terminal that was closed."""

Handler = Callable[[int, FrameType | None], Any] | int | signal.Handlers


class EndedBySignal(SystemExit):
    """A signal came that would have killed the program; raised in its place, so that the block ends as any other."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self._name = signal.Signals(number).name

    def __str__(self) -> str:
        """Which signal it was."""
        return f"ended by {self._name}"


class HeldSignals:
    """A context manager: inside, each signal that ends programs does so once at most, and never while they are held.

    The first of each goes to whom it went before; one that nobody handles raises `EndedBySignal`. Ignored ones stay
    ignored. From `hold` on none gets through; those whose first came then are delivered at the end. Signals come to
    the main thread alone, so in any other it does nothing.
    """

    def __init__(self) -> None:
        self._before: dict[int, Handler] = {}
        self._passed: set[int] = set()
        self._held: list[int] = []
        self._holding = False

    def hold(self) -> None:
        """Let none through from now on."""
        self._holding = True

    def forget(self) -> None:
        """Deliver none at the end: what is told then matters more."""
        self._held = []

    def __enter__(self) -> HeldSignals:
        """Take the signals over."""
        if threading.current_thread() is threading.main_thread():
            for number in ENDING_SIGNALS:
                handler = signal.getsignal(number)
                if handler is not None and handler is not signal.SIG_IGN:
                    self._before[number] = handler
                    signal.signal(number, self._take)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give them back, and deliver what was held."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        for number in dict.fromkeys(self._held):
            if number not in self._passed:
                signal.raise_signal(number)

    def _take(self, number: int, frame: FrameType | None) -> None:
        if self._holding or number in self._passed:
            self._held.append(number)
            return
        self._passed.add(number)
        handler = self._before[number]
        if not callable(handler):
            raise EndedBySignal(number)
        handler(number, frame)
