"""How a job that runs is asked to pause, to stop or to end at once."""

from __future__ import annotations

import threading
from collections.abc import Callable

from bscd.procedures import PausableStop
from bscd.procedures.progress import require_going


class WatchedStop(threading.Event):
    """A request to stop that counts how often it is looked at: whoever follows it is alive."""

    def __init__(self) -> None:
        super().__init__()
        self.looks = 0

    def is_set(self) -> bool:
        """Whether it was asked for."""
        self.looks += 1
        return super().is_set()


class JobControl:
    """``pausable`` goes to procedures that have safe points; ``stop_only`` to those that must not stand still.

    ``at_once`` is called by `abort`: it ends what is moving now.
    """

    def __init__(self, on_pause: Callable[[bool], None], at_once: Callable[[], None]) -> None:
        self.pausable = PausableStop(on_pause)
        self.stop_only = WatchedStop()
        self._at_once = at_once
        self._reason: str | None = None
        self._aborted = threading.Event()

    @property
    def aborted(self) -> str | None:
        """Why it was ended at once, None when it was not."""
        return self._reason

    def wait_aborted(self, timeout_s: float) -> None:
        """Wait for an `abort` that is on its way."""
        self._aborted.wait(timeout_s)

    @property
    def stopping(self) -> bool:
        """Whether it was asked to end, one way or the other."""
        return self.stop_only.is_set()

    def pause(self) -> None:
        """Stand still at the next safe point."""
        self.pausable.pause()

    def resume(self) -> None:
        """Go on."""
        self.pausable.go_on()

    def stop(self) -> None:
        """End at the next safe point and keep what there is."""
        self.stop_only.set()
        self.pausable.set()

    def abort(self, reason: str) -> None:
        """End now: what moves is stopped where it is."""
        if self._reason is None:
            self._reason = reason
        self._aborted.set()
        self.stop()
        self._at_once()

    def require_going(self, where: str, next_step: int = 0) -> None:
        """A safe point: waits for a pause to end, raises `ProcedureStoppedError` for a stop."""
        require_going(self.pausable, where, next_step)
