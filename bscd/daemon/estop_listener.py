"""The e-stop's own listener: a socket and threads of its own, so that it works when the event loop does not."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from bscd.daemon.estop import EmergencyStop

_SOCKET_S = 2.0


class EStopListener:
    """``POST /estop`` on an address of its own; ``admit`` judges the bearer key ("" without one).

    Raises `OSError` when the address is taken. ``port`` is the real one.
    """

    def __init__(self, estop: EmergencyStop, host: str, port: int, admit: Callable[[str], bool]) -> None:
        class Handler(BaseHTTPRequestHandler):
            timeout = _SOCKET_S
            disable_nagle_algorithm = True

            def do_POST(self) -> None:
                if self.path.rstrip("/") not in ("/estop", "/api/v1/estop"):
                    self._answer(HTTPStatus.NOT_FOUND, {"title": "here is only POST /estop"})
                elif not admit(self.headers.get("Authorization", "").removeprefix("Bearer ").strip()):
                    self._answer(HTTPStatus.UNAUTHORIZED, {"title": "the e-stop needs a key here, of any role"})
                else:
                    told = estop.trigger(f"e-stop listener, {self.client_address[0]}")
                    self._answer(HTTPStatus.OK, told.model_dump(mode="json"))

            def do_GET(self) -> None:
                self._answer(HTTPStatus.OK, estop.document().model_dump(mode="json"))

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
            daemon_threads = True
            request_queue_size = 16

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
