"""What goes to the live process: handed over without waiting, and sent by a thread of its own."""

from __future__ import annotations

import queue
import threading
from contextlib import suppress
from multiprocessing.connection import Connection
from pickle import HIGHEST_PROTOCOL, dumps
from typing import Any


class Outbox:
    """Sends messages in their order; a process that reads none holds up this thread alone."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="live outbox", daemon=True)
        self._thread.start()

    def put(self, message: Any) -> None:
        """Send it when its turn comes; never waits. Nothing is told when the process is gone: its answers end."""
        self._waiting.put(dumps(message, HIGHEST_PROTOCOL))

    def put_instead(self, message: Any) -> None:
        """Send this one next, and nothing of what still waits."""
        with suppress(queue.Empty):
            while True:
                self._waiting.get_nowait()
        self.put(message)

    def end(self, timeout_s: float) -> None:
        """Send what waits, and join; it ends at once when the process is gone."""
        self._waiting.put(None)
        self._thread.join(timeout_s)

    def _run(self) -> None:
        with suppress(OSError):  # whoever reads the answers notices as well
            while (message := self._waiting.get()) is not None:
                self._pipe.send_bytes(message)
