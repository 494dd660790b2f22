"""Where a daemon is, and who one is there."""

from __future__ import annotations

from urllib.parse import urlsplit

from bscd.client.errors import NoDaemonError
from bscd.errors import InputError

DEFAULT_URL = "http://127.0.0.1:8080"

#: The e-stop's own port, unless configured otherwise ([daemon] estop_port).
ESTOP_PORT = 8081


class Connection:
    """What both clients know of their daemon. Raises `InputError` for an address that is none."""

    def __init__(
        self, url: str, key: str | None, operator: str | None, estop_url: str | None, timeout_s: float
    ) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise InputError(f"{url}: is no address of a daemon; one is {DEFAULT_URL}")
        self.url, self.timeout_s = url.rstrip("/"), timeout_s
        host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
        self.estop_url = estop_url or f"http://{host}:{ESTOP_PORT}/estop"
        self.headers: dict[str, str] = {}
        if key is not None:
            self.headers["Authorization"] = f"Bearer {key}"
        if operator is not None:
            self.headers["X-Operator"] = operator

    def no_daemon(self, error: Exception) -> NoDaemonError:
        """That nobody answered."""
        told = str(error) or type(error).__name__
        return NoDaemonError(f"{self.url}: no daemon answers ({told}); start one with bscd serve, or name its --url")
