"""Serve a daemon: its API and the e-stop's own listener, until it is asked to end."""

from __future__ import annotations

import asyncio
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import structlog
import uvicorn

from bscd.api.app import create_app
from bscd.api.refusals import Refusals
from bscd.api.security import Gate, is_loopback
from bscd.daemon.daemon import Daemon
from bscd.daemon.estop_listener import EStopListener
from bscd.daemon.watchdog import Watchdog, notify, period_s
from bscd.errors import InputError

_LOG = structlog.get_logger(__name__)
_GRACE_S = 5
_BEAT_S = 0.5


@dataclass(frozen=True)
class Served:
    """Where it answers."""

    url: str
    estop_url: str


def require_safe(daemon: Daemon) -> None:
    """Raise `InputError` for an address that others reach while nobody needs a key."""
    host = daemon.settings.host
    if not is_loopback(host) and daemon.keys.empty:
        raise InputError(
            f"[daemon] host = {host!r} can be reached by others, and there are no keys; make one with "
            f"bscd keys add NAME --role admin, or listen on 127.0.0.1"
        )


def serve(daemon: Daemon, ready: Callable[[Served], None] = lambda _: None) -> None:
    """Serve until SIGINT or SIGTERM; the daemon stays open.

    Raises `InputError` for an address that others reach without keys, or that is taken.
    """
    require_safe(daemon)
    settings = daemon.settings
    with ExitStack() as ends:
        try:
            listener = EStopListener(
                daemon.estop, settings.host, settings.estop_port, Gate(daemon).admit, _noting(daemon)
            )
        except OSError as error:
            raise InputError(
                f"the e-stop's port {settings.estop_port} on {settings.host} can not be had ({error}); "
                f"change [daemon] estop_port"
            ) from error
        ends.callback(listener.close)
        place = ends.enter_context(listening(settings.host, settings.port))
        url = f"http://{_shown(settings.host)}:{place.getsockname()[1]}"
        served = Served(url, f"http://{_shown(settings.host)}:{listener.port}/estop")
        server = Server(daemon, lambda: ready(served))
        if (ping_s := period_s()) is not None:
            ends.callback(Watchdog(daemon.progress() | {"event loop": lambda: server.beats}, ping_s).close)
        _LOG.info("serving", url=served.url, estop=served.estop_url)
        server.run(sockets=[place])
        notify("STOPPING=1")


class Server(uvicorn.Server):
    """Says when it is ready; ends streams before it waits for connections to end; beats while its loop turns."""

    def __init__(self, daemon: Daemon, ready: Callable[[], None]) -> None:
        self._app = create_app(daemon)
        self._ready = ready
        self.beats = 0
        config = uvicorn.Config(
            self._app, log_config=None, access_log=False, timeout_graceful_shutdown=_GRACE_S, ws="none", lifespan="on"
        )
        super().__init__(config)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """As uvicorn's, but the signal is not raised again afterwards: the daemon has to vent and close its files."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {one: signal.signal(one, self.handle_exit) for one in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for one, handler in before.items():
                signal.signal(one, handler)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """As uvicorn's; then tell."""
        await super().startup(sockets=sockets)
        self._beat = asyncio.create_task(self._beating())
        if not self.should_exit:
            notify("READY=1")
            self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """As uvicorn's, streams first."""
        self._app.state.closing.set()
        self._beat.cancel()
        await super().shutdown(sockets=sockets)

    async def _beating(self) -> None:
        while True:
            self.beats += 1
            await asyncio.sleep(_BEAT_S)


def listening(host: str, port: int) -> socket.socket:
    """A socket on an address, so that its port is known before it is served. Raises `InputError` when it is taken."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # its protocol named: else asyncio leaves Nagle's algorithm on, and answers wait 40 ms for an acknowledgement
    place = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    place.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        place.bind((host, port))
    except OSError as error:
        place.close()
        raise InputError(f"port {port} on {host} can not be had ({error.strerror}); change [daemon] port") from error
    return place


def _noting(daemon: Daemon) -> Callable[[str], None]:
    """What the e-stop's listener tells a refused address to."""
    refusals = Refusals(daemon.journal)

    def refused(address: str) -> None:
        if refusals.due(address):
            refusals.note(address, "POST", "/estop", 401, "the e-stop's own listener: no key that is known")

    return refused


def _shown(host: str) -> str:
    return f"[{host}]" if ":" in host else host
