"""The person at the rig, as drivers reach them: the operator's page, a terminal, a test.

A driver asks and waits, with a time-out, polling its clock; whoever reaches the person answers from any thread. So
the asking side needs no thread, and a stop withdraws the question.
"""

from __future__ import annotations

import threading
from enum import StrEnum
from typing import Protocol

from drivers.clock import Clock
from drivers.interfaces import Range

POLL_S = 0.05


class QuestionState(StrEnum):
    """What became of a question."""

    OPEN = "open"
    ANSWERED = "answered"
    WITHDRAWN = "withdrawn"


class Question:
    """A request to a person, answered with a number; safe to use from any thread.

    Attributes
    ----------
    device : str
        Which device asks.
    text : str
        What to do, and what to tell.
    unit : str
        Unit of the answer.
    limits : Range
        What an answer can be.
    proposal : float or None
        The answer if all went as asked; None where it is not known before.
    """

    def __init__(self, device: str, text: str, unit: str, limits: Range, proposal: float | None = None) -> None:
        self.device = device
        self.text = text
        self.unit = unit
        self.limits = limits
        self.proposal = proposal
        self._lock = threading.Lock()
        self._state = QuestionState.OPEN
        self._value: float | None = None

    @property
    def state(self) -> QuestionState:
        """What became of it."""
        return self._state

    @property
    def value(self) -> float | None:
        """The answer; None unless answered."""
        return self._value

    def answer(self, value: float) -> None:
        """Answer it. Raises `ValueError`, for the person to read, when it can not be so or nobody waits any more."""
        with self._lock:
            if self._state is not QuestionState.OPEN:
                raise ValueError(f"{self.device}: the question is {self._state} already")
            if not self.limits.contains(value):
                allowed = f"{self.limits.low:g} to {self.limits.high:g} {self.unit}"
                raise ValueError(f"{self.device}: {value:g} {self.unit} can not be; it must be from {allowed}")
            self._value, self._state = value, QuestionState.ANSWERED

    def withdraw(self) -> None:
        """Nobody waits for the answer any more; does nothing when it is answered."""
        with self._lock:
            if self._state is QuestionState.OPEN:
                self._state = QuestionState.WITHDRAWN

    def wait(self, clock: Clock, timeout_s: float) -> QuestionState:
        """Wait until it is answered or withdrawn; still open after ``timeout_s``."""
        deadline_s = clock.now_s() + timeout_s
        while self._state is QuestionState.OPEN and (left_s := deadline_s - clock.now_s()) > 0.0:
            clock.sleep(min(POLL_S, left_s))
        return self._state


class Operator(Protocol):
    """Whoever brings a question to a person."""

    def ask(self, question: Question) -> None:
        """Show a question and return at once; `Question.answer` is called later. Shown until it is not open."""
        ...

    def tell(self, device: str, text: str) -> None:
        """Show a message that needs no answer, and return at once."""
        ...
