"""What comes to the live process: read as it comes, so that it hears at once when its results are given up."""

from __future__ import annotations

import queue
import threading
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from bscd.errors import BscdError
from bscd.procedures.live.messages import GiveUp


class GivenUpError(BscdError):
    """Whoever wanted the results has given them up; the message says why, ``run`` is the run where it has ended."""

    def __init__(self, reason: str, run: Path | None) -> None:
        self.run = run
        super().__init__(reason)


class Inbox:
    """Messages in their order; `GiveUp` and the pipe's end go before all others."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._given_up: GiveUp | None = None
        threading.Thread(target=self._read, name="live inbox", daemon=True).start()

    def take(self) -> Any:
        """The next message, when it is there. Raises `GivenUpError`."""
        message = self._messages.get()
        self.require_wanted()
        return message

    def require_wanted(self) -> None:
        """Raise `GivenUpError` when the results have been given up."""
        if self._given_up is not None:
            raise GivenUpError(self._given_up.reason, self._given_up.run)

    def give_up(self, asked: GiveUp) -> None:
        """Give the results up; may be called by a signal's handler."""
        self._given_up = self._given_up or asked
        self._messages.put(None)

    def _read(self) -> None:
        try:
            while True:
                message = self._pipe.recv()
                if isinstance(message, GiveUp):
                    self.give_up(message)
                else:
                    self._messages.put(message)
        except (EOFError, OSError):
            self.give_up(GiveUp("live measuring was cut off"))
