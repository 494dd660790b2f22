"""Modbus devices behind a TCP port, a thread a connection: Modbus Messaging on TCP/IP 1.0b."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Mapping
from contextlib import suppress

from drivers.emulators.modbus.pdu import Registers, answer_to
from drivers.emulators.wire import WireFaults

HOST = "127.0.0.1"
HEADER = 7
"""Bytes of transaction, protocol, length and unit."""
NOTICED_WITHIN_S = 0.1
JOINED_WITHIN_S = 5.0


class TcpServer:
    """Serves on loopback; an unplugged one refuses connections.

    Parameters
    ----------
    units : mapping of int to Registers
        The devices; requests to other units get no answer.
    faults : WireFaults
        Faults of its answers. TCP's own checksum guards what it carries, so what can be garbled is the header.
    port : int
        0 takes a free one and keeps it.
    connections : int
        How many it serves at a time; a further one is closed at once.
    """

    def __init__(
        self, units: Mapping[int, Registers], faults: WireFaults, *, port: int = 0, connections: int = 4
    ) -> None:
        self._units = units
        self._faults = faults
        self._port = port
        self._most = connections
        self._lock = threading.Lock()
        self._listener: socket.socket | None = None
        self._stopping = threading.Event()
        self._connections: dict[socket.socket, threading.Thread] = {}
        self._acceptor: threading.Thread | None = None

    @property
    def address(self) -> str:
        """``tcp://127.0.0.1:PORT``; the port is known once started."""
        return f"tcp://{HOST}:{self._port}"

    def start(self) -> None:
        """Listen; does nothing when it does. Raises `OSError` when the port is taken."""
        if self._acceptor is not None:
            return
        self._stopping.clear()
        self._listener = socket.create_server((HOST, self._port))
        self._port = self._listener.getsockname()[1]
        self._listener.settimeout(NOTICED_WITHIN_S)
        self._acceptor = threading.Thread(target=self._accept, args=(self._listener,), name="modbus tcp emulator")
        self._acceptor.start()

    def stop(self) -> None:
        """Close the port and every connection, join the threads; does nothing when stopped."""
        self._stopping.set()
        if self._acceptor is not None:
            self._acceptor.join(JOINED_WITHIN_S)
            self._acceptor = None
        if self._listener is not None:
            self._listener.close()
            self._listener = None
        self.drop()

    def unplug(self) -> None:
        """Refuse every connection; `start` plugs it in again."""
        self.stop()

    def drop(self) -> None:
        """Break every connection, as a device does that is switched off."""
        with self._lock:
            connections = dict(self._connections)
        for connection in connections:
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        for thread in connections.values():
            thread.join(JOINED_WITHIN_S)

    def _accept(self, listener: socket.socket) -> None:
        while not self._stopping.is_set():
            try:
                connection, _ = listener.accept()
            except TimeoutError:
                continue
            with self._lock:
                if len(self._connections) >= self._most:
                    connection.close()
                    continue
                thread = threading.Thread(target=self._serve, args=(connection,), name="modbus tcp connection")
                self._connections[connection] = thread
                thread.start()

    def _serve(self, connection: socket.socket) -> None:
        connection.settimeout(NOTICED_WITHIN_S)
        try:
            while (header := self._receive(connection, HEADER)) is not None:
                transaction, protocol, length, unit = struct.unpack(">HHHB", header)
                body = self._receive(connection, length - 1) if protocol == 0 and 2 <= length <= 254 else None
                if body is None:
                    return
                if unit in self._units:
                    answer = answer_to(body, self._units[unit])
                    self._send(connection, struct.pack(">HHHB", transaction, 0, len(answer) + 1, unit) + answer)
        except OSError:
            pass
        finally:
            with self._lock:
                self._connections.pop(connection, None)
            connection.close()

    def _send(self, connection: socket.socket, answer: bytes) -> None:
        front = self._faults.outgoing(answer[: HEADER + 1])
        whole = len(front) == HEADER + 1
        connection.sendall(front + answer[HEADER + 1 :] if whole else front)

    def _receive(self, connection: socket.socket, size: int) -> bytes | None:
        received = b""
        while len(received) < size:
            try:
                part = connection.recv(size - len(received))
            except TimeoutError:
                if self._stopping.is_set():
                    return None
                continue
            if not part:
                return None
            received += part
        return received
