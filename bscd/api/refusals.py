"""Refusals that may come in floods, in the audit: a line now and then for each address."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import structlog

from bscd.daemon.journal import Journal, JournalError

_LOG = structlog.get_logger(__name__)

#: A line of an address at most so often, and of so many addresses at a time.
_EVERY_S = 10.0
_MOST = 100


class Refusals:
    """Notes refusals of requests that would change something. Safe to use from any thread."""

    def __init__(self, journal: Journal, clock: Callable[[], float] = time.monotonic) -> None:
        self._journal, self._clock = journal, clock
        self._lock = threading.Lock()
        self._due_s: dict[str, float] = {}
        self._left_out = 0

    def due(self, address: str) -> bool:
        """Whether a refusal of that address is to be noted; those in between are counted."""
        with self._lock:
            now_s = self._clock()
            if len(self._due_s) >= _MOST:
                self._due_s = {one: due_s for one, due_s in self._due_s.items() if due_s > now_s}
            if self._due_s.get(address, now_s) > now_s or len(self._due_s) >= _MOST:
                self._left_out += 1
                return False
            self._due_s[address] = now_s + _EVERY_S
            return True

    def note(self, address: str, action: str, target: str, status: int, detail: str) -> None:
        """Write the line of one that is due."""
        with self._lock:
            left_out, self._left_out = self._left_out, 0
        more = f"; {left_out} others like it are not noted" if left_out else ""
        try:
            self._journal.audit(f"unknown, {address}", action, target[:200], str(status), f"{detail}{more}")
        except JournalError as error:
            _LOG.error("the audit could not be written", who=address, path=target[:200], error=str(error))
