"""The far end of a Modbus line that knows a transcript: what it must hear, byte by byte, and what it then says."""

from __future__ import annotations

import os
import pty
import select
import socket
import threading
import tty
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

PATIENCE_S = 5.0
QUIET_S = 0.1


@dataclass
class Heard:
    """What was heard: one entry a message of the transcript, and whatever came beyond it."""

    address: str
    messages: list[bytes] = field(default_factory=list)
    beyond: bytes = b""


def _converse(fd: int, transcript: Sequence[tuple[str, str]], heard: Heard, end: threading.Event) -> None:
    for request, answer in transcript:
        size, message = len(bytes.fromhex(request)), b""
        while len(message) < size:
            if end.is_set() or not select.select([fd], [], [], QUIET_S)[0]:
                if end.is_set():
                    heard.messages.append(message)
                    return
                continue
            message += os.read(fd, size - len(message))
        heard.messages.append(message)
        if message != bytes.fromhex(request):
            return
        os.write(fd, bytes.fromhex(answer))
    while not end.is_set():
        if select.select([fd], [], [], QUIET_S)[0]:
            part = os.read(fd, 1024)
            if not part:
                return
            heard.beyond += part


@contextmanager
def serial_peer(transcript: Sequence[tuple[str, str]]) -> Iterator[Heard]:
    """A serial port whose other end keeps to the transcript (pairs of hexadecimal strings)."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    heard, end = Heard(os.ttyname(theirs)), threading.Event()
    thread = threading.Thread(target=_converse, args=(ours, transcript, heard, end))
    thread.start()
    try:
        yield heard
    finally:
        end.set()
        thread.join(PATIENCE_S)
        os.close(ours)
        os.close(theirs)


@contextmanager
def tcp_peer(transcript: Sequence[tuple[str, str]]) -> Iterator[Heard]:
    """A TCP port whose other end keeps to the transcript with the first who connects."""
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(PATIENCE_S)
    heard, end = Heard(f"tcp://127.0.0.1:{server.getsockname()[1]}"), threading.Event()

    def serve() -> None:
        connection, _ = server.accept()
        with connection:
            _converse(connection.fileno(), transcript, heard, end)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield heard
    finally:
        end.set()
        thread.join(PATIENCE_S)
        server.close()
