"""How a procedure says where it is, and how it is asked to stop."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from bscd.errors import BscdError


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


ProgressCallback = Callable[[Progress], None]


def require_going(stop: threading.Event | None, where: str, next_step: int = 0) -> None:
    """Raise `ProcedureStoppedError` when a stop was asked for."""
    if stop is not None and stop.is_set():
        raise ProcedureStoppedError(f"{where}: stopped as asked", next_step)
