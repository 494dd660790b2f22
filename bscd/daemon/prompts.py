"""What the operator is asked: confirmations by recipes, readings by drivers (a lab jack that is turned by hand)."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable

from bscd.daemon.documents import PromptDocument
from bscd.daemon.errors import UnknownNameError
from bscd.daemon.running.control import JobControl
from bscd.errors import CheckFailedError, InputError
from drivers.clock import Clock
from drivers.interfaces import Range
from drivers.operator import Question, QuestionState

_SLICE_S = 0.2

#: The "number" that a confirmation is answered with.
_CONFIRMED = 1.0


class Prompts:
    """The question that is open, if any; a `drivers.operator.Operator` for drivers. Safe to use from any thread.

    ``on_change`` is called when a question opens and when it is answered; ``on_tell`` with what needs no answer.
    ``unattended`` (the digital twin) confirms by itself, and answers a driver with what it proposes.
    """

    def __init__(
        self,
        clock: Clock,
        timeout_s: float,
        on_change: Callable[[], None],
        on_tell: Callable[[str], None],
        *,
        unattended: bool = False,
    ) -> None:
        self._clock, self._timeout_s = clock, timeout_s
        self._on_change, self._on_tell = on_change, on_tell
        self._unattended = unattended
        self._lock = threading.Lock()
        self._numbers = itertools.count(1)
        self._open: tuple[int, Question, bool] | None = None

    @property
    def document(self) -> PromptDocument | None:
        """The open question."""
        with self._lock:
            held = self._open
        if held is None or held[1].state is not QuestionState.OPEN:
            return None
        number, question, confirms = held
        return PromptDocument(
            id=number,
            text=question.text,
            device=question.device,
            unit="" if confirms else question.unit,
            limits=None if confirms else (question.limits.low, question.limits.high),
            proposal=None if confirms else question.proposal,
        )

    def ask(self, question: Question) -> None:
        """Show a driver's question; see `drivers.operator.Operator`."""
        self._show(question, confirms=False)

    def tell(self, device: str, text: str) -> None:
        """Show a driver's message."""
        self._on_tell(f"{device}: {text}" if device else text)

    def confirm(self, text: str, control: JobControl) -> None:
        """Wait until the operator has confirmed ``text``.

        Raises `ProcedureStoppedError` for a stop, `CheckFailedError` when nobody confirmed in time.
        """
        question = Question("operator", text, "", Range(_CONFIRMED, _CONFIRMED), _CONFIRMED)
        self._show(question, confirms=True)
        ends_s = self._clock.now_s() + self._timeout_s
        try:
            while question.wait(self._clock, _SLICE_S) is QuestionState.OPEN:
                control.require_going(f"while waiting for the operator ({text})")
                if self._clock.now_s() > ends_s:
                    raise CheckFailedError(f"nobody confirmed in {self._timeout_s:g} s: {text}")
        finally:
            answered = question.state is QuestionState.ANSWERED
            question.withdraw()
            self._on_change()
        if not answered:
            raise CheckFailedError(f"the question was withdrawn before anybody confirmed: {text}")

    def withdraw(self) -> None:
        """Have a driver not wait for its answer any more; a recipe's question looks after a stop by itself."""
        with self._lock:
            held = self._open
        if held is not None and not held[2]:
            held[1].withdraw()
            self._on_change()

    def answer(self, number: int, value: float | None) -> None:
        """Answer the open question. Raises `UnknownNameError` when it is not that one, `InputError` for the value."""
        with self._lock:
            held = self._open
        if held is None or held[0] != number or held[1].state is not QuestionState.OPEN:
            raise UnknownNameError(f"question {number}: is not open; look at the job for the one that is")
        _, question, confirms = held
        if confirms:
            value = _CONFIRMED
        if value is None:
            raise InputError(f"question {number}: give a value in {question.unit}")
        try:
            question.answer(value)
        except ValueError as error:
            raise InputError(str(error)) from error
        self._on_change()

    def _show(self, question: Question, *, confirms: bool) -> None:
        with self._lock:
            self._open = next(self._numbers), question, confirms
        if self._unattended and question.proposal is not None:
            question.answer(question.proposal)
            return
        self._on_change()
