"""Control of the rig: one person at a time, for as long as they renew it; the e-stop asks nobody."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from bscd.daemon.documents import LeaseDocument
from bscd.daemon.errors import NotInControlError


class ControlLease:
    """Held by one name for ``lease_s`` from when it was last taken, renewed or used. Safe to use from any thread."""

    def __init__(self, lease_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._lease_s, self._clock = lease_s, clock
        self._lock = threading.Lock()
        self._holder, self._ends_s = "", 0.0

    def take(self, holder: str, *, force: bool = False) -> LeaseDocument:
        """Take or renew it. Raises `NotInControlError` while another holds it, unless ``force``."""
        with self._lock:
            if self._held() and self._holder != holder and not force:
                raise NotInControlError(
                    f"{self._holder} is in control until {self._until():%H:%M:%S} UTC; ask them for it, or wait"
                )
            self._holder, self._ends_s = holder, self._clock() + self._lease_s
            return LeaseDocument(holder=holder, until=self._until())

    def require(self, holder: str) -> LeaseDocument:
        """Whoever changes something is in control, or is now that nobody else is. Raises `NotInControlError`."""
        return self.take(holder)

    def release(self, holder: str) -> None:
        """Give it back; does nothing for who does not hold it."""
        with self._lock:
            if self._holder == holder:
                self._holder, self._ends_s = "", 0.0

    def document(self) -> LeaseDocument | None:
        """Who is in control, None when nobody is."""
        with self._lock:
            return LeaseDocument(holder=self._holder, until=self._until()) if self._held() else None

    def _held(self) -> bool:
        return bool(self._holder) and self._clock() < self._ends_s

    def _until(self) -> datetime:
        return datetime.now(UTC) + timedelta(seconds=self._ends_s - self._clock())
