"""Questions and answers with one XIMC controller: in step, or brought back into step.

Whenever an answer fails to come or makes no sense, the next exchange begins with a resynchronisation: zeros, which
the controller answers by a zero once it waits for a command, then a question that was not asked just before. Since
answers keep the order of the questions, nothing that comes before its answer is taken for anything.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from itertools import cycle

from drivers.stages.line import (
    BadAnswerError,
    Line,
    LineError,
    LineLostError,
    NoAnswerError,
    OpenLine,
    RefusedError,
)
from drivers.stages.ximc.messages import CODE_LENGTH, answer_length, decode, encode

ZEROS = bytes(64)
"""Longer than any message, so that they end one that was cut off."""
ATTEMPTS = 2
MARKERS = ("gser", "gfwv", "geti", "gblv")
"""Questions that tell nothing that changes; four, so that a late answer to one is not taken for another's."""


class Dialogue:
    """Safe to use from any thread; every message may be repeated, and is once when its answer fails to come.

    Parameters
    ----------
    open_line : callable
        Opens the line.
    answer_timeout_s : float
        How long a message, and a resynchronisation, waits for its answer.
    """

    def __init__(self, open_line: OpenLine, answer_timeout_s: float) -> None:
        self._open_line = open_line
        self._timeout_s = answer_timeout_s
        self._lock = threading.Lock()
        self._line: Line | None = None
        self._in_step = False
        self._markers = cycle(MARKERS)

    def open(self) -> None:
        """Open the line; does nothing when it is open."""
        with self._lock:
            if self._line is None:
                self._line = self._open_line()
                self._in_step = False

    def close(self) -> None:
        """Close the line; never raises, may be called twice."""
        with self._lock:
            if self._line is not None:
                self._line.close()
                self._line = None

    def ask(self, code: str, values: tuple[int, ...] = ()) -> tuple[int | bytes, ...]:
        """Send a message and give the values of its answer.

        Raises `NoAnswerError`, `BadAnswerError`, `RefusedError` and `LineLostError`.
        """
        with self._lock:
            for attempt in range(1, ATTEMPTS + 1):
                try:
                    if not self._in_step:
                        self._resynchronise()
                    return self._exchange(code, encode(code, values))
                except (NoAnswerError, BadAnswerError):
                    self._in_step = False
                    if attempt == ATTEMPTS:
                        raise
        raise LineError("no attempt was made")

    def _require_line(self) -> Line:
        if self._line is None:
            raise LineLostError("the port is closed")
        return self._line

    def _exchange(self, code: str, message: bytes) -> tuple[int | bytes, ...]:
        line = self._require_line()
        if line.read(0.0).strip(b"\0"):
            raise BadAnswerError("it said something that nobody asked for")
        line.write(message)
        deadline_s = time.monotonic() + self._timeout_s
        answer = b""
        while len(answer) < self._expected(code, answer):
            more = line.read(deadline_s - time.monotonic())
            if not more and time.monotonic() >= deadline_s:
                raise NoAnswerError(
                    f"only {len(answer)} of {answer_length(code)} bytes within {self._timeout_s:g} s"
                    if answer
                    else f"no answer within {self._timeout_s:g} s"
                )
            answer = (answer + more).lstrip(b"\0")
        return self._understood(code, answer)

    def _expected(self, code: str, answer: bytes) -> int:
        """Bytes of the whole answer; an error's are the code's alone."""
        wrong = len(answer) >= CODE_LENGTH and answer[:CODE_LENGTH] != code.encode()
        return CODE_LENGTH if wrong else answer_length(code)

    def _understood(self, code: str, answer: bytes) -> tuple[int | bytes, ...]:
        if answer == b"errc":
            raise RefusedError(f"the controller does not know the command {code!r}")
        if answer == b"errv":
            raise RefusedError(f"the controller has clipped a value of the command {code!r}")
        if answer == b"errd":
            raise BadAnswerError(f"the command {code!r} reached it garbled")
        values = decode(code, answer)
        if values is None:
            raise BadAnswerError(f"the answer to the command {code!r} is garbled")
        return values

    def _resynchronise(self) -> None:
        line = self._require_line()
        deadline_s = time.monotonic() + self._timeout_s
        while line.read(0.0) and time.monotonic() < deadline_s:
            continue
        line.write(ZEROS)
        self._await(deadline_s, lambda came: b"\0" in came)
        marker = next(self._markers)
        line.write(encode(marker))
        length = answer_length(marker)
        self._await(deadline_s, lambda came: decode(marker, came[-length:]) is not None)
        self._in_step = True

    def _await(self, deadline_s: float, enough: Callable[[bytes], bool]) -> None:
        """Read until it is enough, whatever comes before."""
        came = b""
        while not enough(came):
            more = self._require_line().read(deadline_s - time.monotonic())
            came += more
            if not more and time.monotonic() >= deadline_s:
                if came.strip(b"\0"):
                    raise BadAnswerError(f"it says things that make no sense, for {self._timeout_s:g} s")
                raise NoAnswerError(f"no answer within {self._timeout_s:g} s")
