"""How a procedure says where it is, and how it is asked to stop."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from bscd.errors import BscdError

#: A pause looks for a stop so often.
_LOOK_S = 0.1


class ProcedureStoppedError(BscdError):
    """A procedure ended early because it was asked to; not a fault. ``next_step`` is where it can go on."""

    def __init__(self, message: str, next_step: int = 0) -> None:
        self.next_step = next_step
        super().__init__(message)


@dataclass(frozen=True)
class Progress:
    """``done`` of ``total`` steps, and what is being done now in words."""

    done: int
    total: int
    doing: str


class PausableStop(threading.Event):
    """A request to stop that can also be one to pause: at the next safe point the procedure waits, at rest.

    ``on_pause`` is called with True when it waits there and with False when it goes on, on the procedure's thread.
    """

    def __init__(self, on_pause: Callable[[bool], None] = lambda _: None) -> None:
        super().__init__()
        self._on_pause = on_pause
        self._may_go = threading.Event()
        self._may_go.set()

    def pause(self) -> None:
        """Wait at the next safe point."""
        self._may_go.clear()

    def go_on(self) -> None:
        """Go on from the safe point, or do not wait at the next one."""
        self._may_go.set()

    def safe_point(self) -> None:
        """Wait here while a pause is asked for; a stop ends the wait."""
        if self._may_go.is_set() or self.is_set():
            return
        self._on_pause(True)
        while not (self._may_go.wait(_LOOK_S) or self.is_set()):
            pass
        self._on_pause(False)


ProgressCallback = Callable[[Progress], None]


def require_going(stop: threading.Event | None, where: str, next_step: int = 0) -> None:
    """Raise `ProcedureStoppedError` when a stop was asked for; a `PausableStop` may wait here first."""
    if isinstance(stop, PausableStop):
        stop.safe_point()
    if stop is not None and stop.is_set():
        raise ProcedureStoppedError(f"{where}: stopped as asked", next_step)
