"""Messages and replies on a line of Zaber devices, which all axes of this program on that line share.

Every message bears a number, and so does its reply: one that comes late is told from the one that is awaited.
"""

from __future__ import annotations

import os
import threading
import time

from drivers.stages.line import (
    BadAnswerError,
    Line,
    LineError,
    LineLostError,
    LineTakenError,
    NoAnswerError,
    RefusedError,
    open_line,
)
from drivers.stages.zaber.messages import MESSAGE_IDS, REJECTIONS, Reply, decode, encode

ATTEMPTS = 2
LONGEST_LINE = 1024


class Dialogue:
    """Safe to use from any thread; every message may be repeated, and is once when its reply fails to come."""

    def __init__(self, port: str, line: Line) -> None:
        self.port = port
        """The port's own name: a link to it is gone when it is unplugged."""
        self.users = 0
        self._lock = threading.Lock()
        self._line: Line | None = line
        self._message_id = 0
        self._came = b""

    @property
    def lost(self) -> bool:
        """Whether the line is gone."""
        return self._line is None

    def close(self) -> None:
        """Close the line; never raises, may be called twice."""
        with self._lock:
            self._drop()

    def ask(self, address: int, axis: int, command: str, *, timeout_s: float, unchecked: bool = False) -> Reply:
        """Send a command and give its reply, without check digits too when ``unchecked``.

        Raises `NoAnswerError`, `BadAnswerError`, `RefusedError` and `LineLostError`.
        """
        with self._lock:
            for attempt in range(1, ATTEMPTS + 1):
                try:
                    reply = self._exchange(address, axis, command, timeout_s, unchecked)
                    break
                except (LineLostError, LineTakenError):
                    self._drop()
                    raise
                except (NoAnswerError, BadAnswerError):
                    if attempt == ATTEMPTS:
                        raise
            else:
                raise LineError("no attempt was made")
        if not reply.accepted:
            raise RefusedError(f"it refuses {command!r}: {REJECTIONS.get(reply.data, reply.data)}")
        return reply

    def _drop(self) -> None:
        if self._line is not None:
            self._line.close()
            self._line = None

    def _exchange(self, address: int, axis: int, command: str, timeout_s: float, unchecked: bool) -> Reply:
        if self._line is None:
            raise LineLostError("the port is closed")
        message_id = self._message_id
        self._message_id = (message_id + 1) % MESSAGE_IDS
        self._line.write(encode(address, axis, message_id, command))
        deadline_s = time.monotonic() + timeout_s
        garbled = False
        while True:
            while b"\n" in self._came:
                text, _, self._came = self._came.partition(b"\n")
                reply = decode(text, unchecked=unchecked)
                if reply and (reply.address, reply.axis, reply.message_id) == (address, axis, message_id):
                    return reply
                garbled = garbled or (reply is None and not text.startswith((b"!", b"#")))
            more = self._line.read(deadline_s - time.monotonic())
            self._came = (self._came + more)[-LONGEST_LINE:]
            if not more and time.monotonic() >= deadline_s:
                break
        if garbled:
            raise BadAnswerError(f"the reply to {command!r} is garbled")
        raise NoAnswerError(f"no {'whole ' if self._came else ''}answer within {timeout_s:g} s")


_dialogues: dict[str, Dialogue] = {}
_joining = threading.Lock()


def join(port: str, *, baud: int, timeout_s: float) -> Dialogue:
    """The dialogue on a port, opened if it is not. Raises `LineTakenError` and `LineLostError`."""
    key = _key(port)
    with _joining:
        dialogue = _dialogues.get(key)
        if dialogue is None or dialogue.lost:
            dialogue = Dialogue(key, open_line(port, baud=baud, stop_bits=1, timeout_s=timeout_s))
            _dialogues[key] = dialogue
        dialogue.users += 1
        return dialogue


def leave(dialogue: Dialogue) -> None:
    """Take one user off a dialogue; the last one closes it."""
    with _joining:
        dialogue.users -= 1
        if dialogue.users == 0:
            dialogue.close()
            if _dialogues.get(dialogue.port) is dialogue:
                del _dialogues[dialogue.port]


def _key(port: str) -> str:
    return port if port.startswith("tcp://") else os.path.realpath(port)
