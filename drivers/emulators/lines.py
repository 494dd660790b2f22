"""The two lines that an emulator's bytes travel on: a pseudo-terminal, as a USB serial port is one, and TCP.

A line keeps its address when it is stopped and started again, so ``stop`` is what pulling the plug does and
``start`` plugs it in again.
"""

from __future__ import annotations

import errno
import os
import pty
import secrets
import select
import selectors
import shutil
import socket
import tempfile
import threading
import tty
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal, Protocol

from drivers.emulators.wire import WireFaults

LOOPBACK = "127.0.0.1"
WRITE_TIMEOUT_S = 1.0
JOIN_TIMEOUT_S = 10.0
CHUNK = 4096

Transport = Literal["pty", "tcp"]


class PortTakenError(OSError):
    """Another program has the TCP port; end it, or take another port."""


class Session(Protocol):
    """What one client talks to; called by one thread."""

    def receive(self, data: bytes) -> Iterable[bytes]:
        """Take what came, in pieces of any size, and give the answers, each one whole."""
        ...


class _Line:
    """One thread that serves whoever is connected; subclasses open and close what it listens to."""

    def __init__(self, open_session: Callable[[], Session], faults: WireFaults) -> None:
        self._open_session = open_session
        self._faults = faults
        self._changing = threading.Lock()
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._selector = selectors.DefaultSelector()
        self._wake = (-1, -1)

    def start(self) -> None:
        """Serve, at the address of the last time; does nothing when it does. Raises `OSError` when it is taken."""
        with self._changing:
            if self._thread is not None:
                return
            self._selector = selectors.DefaultSelector()
            try:
                self._listen()
            except OSError:
                self._selector.close()
                raise
            self._wake = os.pipe()
            self._stopping.clear()
            self._selector.register(self._wake[0], selectors.EVENT_READ)
            self._thread = threading.Thread(target=self._serve, name=f"emulator at {self.address}", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Break all connections and join the thread; does nothing when stopped."""
        with self._changing:
            if self._thread is None:
                return
            self._stopping.set()
            os.write(self._wake[1], b"x")
            self._thread.join(JOIN_TIMEOUT_S + self._faults.late_s)
            self._thread = None
            self._hang_up()
            self._selector.close()
            for end in self._wake:
                os.close(end)

    @property
    def address(self) -> str:
        """What a driver is given as its port."""
        raise AttributeError("a line of no kind has no address")

    def _listen(self) -> None:
        """Open, and register a callable for whatever can be read."""

    def _hang_up(self) -> None:
        """Close everything that was opened."""

    def _serve(self) -> None:
        while True:
            for key, _ in self._selector.select():
                if key.data is None:
                    return
                key.data()

    def _answer(self, fd: int, session: Session, data: bytes) -> None:
        for answer in session.receive(data):
            if self._stopping.is_set() or not self._write(fd, self._faults.outgoing(answer)):
                return

    def _write(self, fd: int, data: bytes) -> bool:
        """Write all of it; False when the line is stopped, or its client does not read."""
        while data:
            try:
                data = data[os.write(fd, data) :]
            except BlockingIOError:
                stopped, ready, _ = select.select([self._wake[0]], [fd], [], WRITE_TIMEOUT_S)
                if stopped or not ready:
                    return False
        return True


class TcpLine(_Line):
    """A TCP server on loopback, as a serial device server is one.

    Parameters
    ----------
    open_session : callable
        Makes the session of a client that connects.
    faults : WireFaults
        Strike every answer.
    port : int
        0 takes a free one, and keeps it.
    clients : int
        How many may be connected at once; one more is hung up on.
    """

    def __init__(
        self, open_session: Callable[[], Session], faults: WireFaults, *, port: int = 0, clients: int = 1
    ) -> None:
        super().__init__(open_session, faults)
        self._port = port
        self._most = clients
        self._server: socket.socket | None = None
        self._clients: set[socket.socket] = set()

    @property
    def address(self) -> str:
        """``tcp://127.0.0.1:PORT``; a port of 0 becomes a real one at `start`."""
        return f"tcp://{LOOPBACK}:{self._port}"

    def _listen(self) -> None:
        try:
            server = socket.create_server((LOOPBACK, self._port))
        except OSError as err:
            if err.errno != errno.EADDRINUSE:
                raise
            raise PortTakenError(f"port {self._port} of {LOOPBACK} is in use by another program") from err
        server.setblocking(False)
        self._port = server.getsockname()[1]
        self._server = server
        self._selector.register(server, selectors.EVENT_READ, lambda: self._accept(server))

    def _accept(self, server: socket.socket) -> None:
        try:
            client, _ = server.accept()
        except OSError:  # it left before it was let in
            return
        for gone in [other for other in self._clients if _has_hung_up(other)]:
            self._drop(gone)  # it left just before this one came
        if len(self._clients) >= self._most:
            client.close()
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._clients.add(client)
        session = self._open_session()
        self._selector.register(client, selectors.EVENT_READ, lambda: self._read(client, session))

    def _read(self, client: socket.socket, session: Session) -> None:
        try:
            data = client.recv(CHUNK)
            if data:
                self._answer(client.fileno(), session, data)
                return
        except BlockingIOError:
            return
        except OSError:  # reset by the client: it is gone, as at the end of its stream
            pass
        if client in self._clients:
            self._drop(client)

    def _drop(self, client: socket.socket) -> None:
        self._selector.unregister(client)
        self._clients.discard(client)
        client.close()

    def _hang_up(self) -> None:
        for client in self._clients:
            client.close()
        self._clients.clear()
        if self._server is not None:
            self._server.close()
            self._server = None


class PtyLine(_Line):
    """A pseudo-terminal behind a link of constant name, as ``/dev/serial/by-id`` has them.

    Parameters
    ----------
    open_session : callable
        Makes the one session; clients that follow each other share it, as they share a device.
    faults : WireFaults
        Strike every answer.
    """

    def __init__(self, open_session: Callable[[], Session], faults: WireFaults) -> None:
        super().__init__(open_session, faults)
        self._link = Path(tempfile.gettempdir(), f"bscd-{os.getpid()}-{secrets.token_hex(4)}", "serial")
        self._ends: tuple[int, ...] = ()

    @property
    def address(self) -> str:
        """The link to the terminal's device."""
        return str(self._link)

    def _listen(self) -> None:
        # our own hold on the client's end keeps the line up while no client has it open
        master, slave = self._ends = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self._link.parent.mkdir(mode=0o700)
        self._link.symlink_to(os.ttyname(slave))
        session = self._open_session()
        self._selector.register(master, selectors.EVENT_READ, lambda: self._read(master, session))

    def _read(self, master: int, session: Session) -> None:
        try:
            data = os.read(master, CHUNK)
        except BlockingIOError:
            return
        self._answer(master, session, data)

    def _hang_up(self) -> None:
        for end in self._ends:
            os.close(end)
        self._ends = ()
        shutil.rmtree(self._link.parent)


Line = TcpLine | PtyLine


class Lines:
    """All lines to the same devices, started and stopped together; safe to use from any thread."""

    def __init__(self, *lines: Line) -> None:
        self._lines = lines

    @property
    def addresses(self) -> tuple[str, ...]:
        """What a driver is given as its port, for each line."""
        return tuple(line.address for line in self._lines)

    def start(self) -> None:
        """Serve on all of them, or on none. Raises `OSError` when an address is taken."""
        try:
            for line in self._lines:
                line.start()
        except OSError:
            self.stop()
            raise

    def stop(self) -> None:
        """Break all connections."""
        for line in self._lines:
            line.stop()


def open_lines(
    transport: Transport, open_session: Callable[[], Session], faults: WireFaults, *, port: int = 0, also_pty: bool
) -> Lines:
    """A line of the kind asked for, and a pseudo-terminal beside it; each has a session of its own."""
    line = open_line(transport, open_session, faults, port=port)
    return Lines(line, PtyLine(open_session, faults)) if also_pty else Lines(line)


def open_line(
    transport: Transport, open_session: Callable[[], Session], faults: WireFaults, *, port: int = 0, clients: int = 1
) -> Line:
    """A line of the kind asked for; ``port`` and ``clients`` are TCP's."""
    if transport == "pty":
        return PtyLine(open_session, faults)
    return TcpLine(open_session, faults, port=port, clients=clients)


def _has_hung_up(client: socket.socket) -> bool:
    try:
        return client.recv(1, socket.MSG_PEEK) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True
