"""Where a daemon is, and who one is there."""

from __future__ import annotations

import re
import unicodedata
from urllib.parse import urlsplit

from bscd.client.errors import NoDaemonError
from bscd.errors import InputError

DEFAULT_URL = "http://127.0.0.1:8080"

#: The e-stop's own port, unless configured otherwise ([daemon] estop_port).
ESTOP_PORT = 8081

#: How long the API may take to stop everything before the e-stop's own address is asked, and that one then.
ESTOP_API_S = 2.0
ESTOP_OWN_S = 5.0


class Connection:
    """What both clients know of their daemon. Raises `InputError` for an address that is none."""

    def __init__(
        self, url: str, key: str | None, operator: str | None, estop_url: str | None, timeout_s: float
    ) -> None:
        hostname = _hostname(url)
        self.url, self.timeout_s = url.rstrip("/"), timeout_s
        host = f"[{hostname}]" if ":" in hostname else hostname
        self.estop_url = estop_url or f"http://{host}:{ESTOP_PORT}/estop"
        self.headers: dict[str, str] = {}
        if key is not None:
            self.headers["Authorization"] = f"Bearer {_NO_HEADER.sub('?', key)}"
        if operator is not None and (name := header_name(operator)):
            self.headers["X-Operator"] = name

    def no_daemon(self, error: Exception) -> NoDaemonError:
        """That nobody answered."""
        told = str(error) or type(error).__name__
        return NoDaemonError(f"{self.url}: no daemon answers ({told}); start one with bscd serve, or name its --url")

    def not_stopped(self, api: Exception, own: Exception) -> NoDaemonError:
        """That neither way to the e-stop did."""
        told = " ".join(f"{own}".split()) or type(own).__name__
        return NoDaemonError(f"the e-stop is not confirmed, act by hand: {api}; {self.estop_url}: neither ({told})")


_NO_HEADER = re.compile(r"[^\x21-\x7e]")
_NO_NAME = re.compile(r"[^A-Za-z0-9_ .@-]")


def header_name(operator: str) -> str:
    """An operator's name as its header can hold it: without accents, - for what is no letter; "" where none is left."""
    plain = "".join(one for one in unicodedata.normalize("NFKD", operator) if not unicodedata.combining(one))
    return _NO_NAME.sub("-", plain).lstrip(" .@-")[:80].rstrip()


def _hostname(url: str) -> str:
    try:
        parts = urlsplit(url)
        if parts.scheme in ("http", "https") and parts.hostname and parts.port != 0:
            return parts.hostname
    except ValueError:  # brackets that do not close, a port that is none
        pass
    raise InputError(f"{url}: is no address of a daemon; one is {DEFAULT_URL}")
