"""What systemd is told: that the daemon is ready, and again and again that it makes progress, as long as it does."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable, Mapping

import structlog

_LOG = structlog.get_logger(__name__)
_JOIN_S = 5.0


def notify(message: str) -> bool:
    """Send a message to systemd (sd_notify(3)); False where nobody listens."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")):
        return False
    place = "\0" + address[1:] if address.startswith("@") else address
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as to:
            to.settimeout(1.0)
            to.connect(place)
            to.sendall(message.encode())
    except OSError as error:
        _LOG.warning("systemd could not be told", error=str(error))
        return False
    return True


def period_s() -> float | None:
    """How often systemd wants a ping: a third of WATCHDOG_USEC; None where it wants none of this process."""
    wanted = os.environ.get("WATCHDOG_USEC", "")
    owner = os.environ.get("WATCHDOG_PID", str(os.getpid()))
    if not wanted.isdigit() or int(wanted) == 0 or owner != str(os.getpid()):
        return None
    return int(wanted) * 1e-6 / 3.0


class Watchdog:
    """Pings systemd each ``period_s`` while every counter of ``counters`` has grown since the last ping.

    A counter is what a part of the daemon counts its turns by; one that stands still holds the pings back, is logged
    once, and systemd restarts the daemon. A context manager that joins its thread.
    """

    def __init__(self, counters: Mapping[str, Callable[[], int]], period_s: float) -> None:
        self._counters, self._period_s = counters, period_s
        self._seen = dict.fromkeys(counters, -1)
        self._still: set[str] = set()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="watchdog", daemon=True)
        self._thread.start()

    def look(self) -> list[str]:
        """The parts that have not moved since the last look in which all had."""
        now = {name: counter() for name, counter in self._counters.items()}
        still = [name for name, count in now.items() if count == self._seen[name]]
        if not still:
            self._seen = now
        return still

    def close(self) -> None:
        """End it."""
        self._ending.set()
        self._thread.join(_JOIN_S)

    def _run(self) -> None:
        while not self._ending.wait(self._period_s):
            still = self.look()
            if still:
                news = set(still) - self._still
                if news:
                    _LOG.error("no progress, the watchdog is not fed", parts=sorted(news))
            else:
                notify("WATCHDOG=1")
            self._still = set(still)
