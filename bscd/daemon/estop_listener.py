"""The e-stop's own listener: a socket and threads of its own, so that it works when the event loop does not."""

from __future__ import annotations

import json
import re
import socket
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import structlog

from bscd.daemon.estop import EmergencyStop
from bscd.daemon.keys import LOCAL, operator_name

_LOG = structlog.get_logger(__name__)

REASON_S = 0.25
"""The e-stop waits so long for its reason, and no longer."""

_SOCKET_S = 2.0
_MOST_BYTES = 1 << 20
_MOST_CHARACTERS = 200
_LENGTH = re.compile(r"[0-9]{1,18}")


def printable(reason: str) -> str:
    """A reason in one line of at most 200 characters."""
    return " ".join("".join(one if one.isprintable() else " " for one in reason).split())[:_MOST_CHARACTERS]


def reason_of(body: bytes) -> str:
    """The ``reason`` of an e-stop's body; "" where it has none: nothing that is sent keeps the rig from stopping."""
    with suppress(ValueError, RecursionError):
        told = json.loads(body.decode("utf-8", "replace"))
        if isinstance(told, dict) and isinstance(told.get("reason"), str):
            return printable(told["reason"])
    return ""


class EStopListener:
    """``POST /estop`` on an address of its own.

    ``admit`` is given the bearer key ("" without one) and tells whose it is: `LOCAL` where nobody needs one, None for
    who may not. ``refused`` is told the address that a refused one came from. Raises `OSError` when the address is
    taken. ``port`` is the real one.
    """

    def __init__(
        self,
        estop: EmergencyStop,
        host: str,
        port: int,
        admit: Callable[[str], str | None],
        refused: Callable[[str], None] = lambda _: None,
    ) -> None:
        class Handler(BaseHTTPRequestHandler):
            timeout = _SOCKET_S
            disable_nagle_algorithm = True

            def do_POST(self) -> None:
                if not self.path.partition("?")[0].rstrip("/").endswith("/estop"):
                    self._refuse(HTTPStatus.NOT_FOUND, "not-found", "here is only POST /estop")
                elif not (name := admit(self._key())):
                    refused(self.client_address[0])
                    self._refuse_key()
                else:
                    if name == LOCAL:
                        name = operator_name(self.headers.get("X-Operator", "")) or LOCAL
                    length = self.headers.get("Content-Length", "")
                    reason = reason_of(self._body(int(length) if _LENGTH.fullmatch(length) else 0))
                    told = estop.trigger(f"{name}, e-stop listener, {self.client_address[0]}", reason)
                    if "Transfer-Encoding" in self.headers:
                        self._body(_MOST_BYTES)  # what is left unread would cut off the answer
                    self._answer(HTTPStatus.OK, told.model_dump(mode="json"))

            def do_GET(self) -> None:
                if admit(self._key()):
                    self._answer(HTTPStatus.OK, estop.document().model_dump(mode="json"))
                else:
                    self._refuse_key()

            def _key(self) -> str:
                scheme, _, key = self.headers.get("Authorization", "").partition(" ")
                return key.strip() if scheme.lower() == "bearer" else ""

            def _body(self, length: int) -> bytes:
                """What was sent, as far as it comes at once."""
                body, ends_s, length = b"", time.monotonic() + REASON_S, min(length, _MOST_BYTES)
                with suppress(OSError):
                    while len(body) < length and (left_s := ends_s - time.monotonic()) > 0.0:
                        self.connection.settimeout(left_s)
                        piece = self.rfile.read1(length - len(body))
                        if not piece:
                            break
                        body += piece
                self.connection.settimeout(_SOCKET_S)
                return body

            def _refuse_key(self) -> None:
                self._refuse(HTTPStatus.UNAUTHORIZED, "unauthorised", "the e-stop needs a key here, of any role")

            def _refuse(self, status: HTTPStatus, code: str, detail: str) -> None:
                self._answer(status, {"title": status.phrase, "status": status, "code": code, "detail": detail})

            def _answer(self, status: HTTPStatus, told: object) -> None:
                body = json.dumps(told).encode()
                self.send_response(status)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:  # a request line could hold a key
                return

        class Server(ThreadingHTTPServer):
            address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
            daemon_threads = True
            request_queue_size = 16

            def handle_error(self, request: object, client_address: tuple[str, int]) -> None:
                _LOG.warning("the e-stop's listener", address=client_address[0], error=repr(sys.exception()))

        self._server = Server((host, port), Handler)
        self.port = int(self._server.server_address[1])
        self._thread = threading.Thread(
            target=lambda: self._server.serve_forever(poll_interval=0.1), name="e-stop listener", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """End it and give the address back."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(_SOCKET_S)
