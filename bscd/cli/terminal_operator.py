"""The person at a command's terminal, for drivers that ask one: lab jacks that are turned by hand."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
from contextlib import suppress

import typer

from drivers.errors import NotConnectedError
from drivers.operator import Question, QuestionState

LOOK_S = 0.1
LINE_BYTES = 4096
"""Longest line of a terminal."""


class TerminalOperator:
    """A `drivers.operator.Operator`: asks on stderr, and takes what is typed at the terminal on standard input.

    An empty line says that all is as asked; the end of the input (Ctrl-D) withdraws the question, as ``stop`` does.

    Parameters
    ----------
    stop : threading.Event
        Once set, nothing is asked any more.
    """

    def __init__(self, stop: threading.Event) -> None:
        self._stop = stop
        self._talking = threading.Lock()

    def ask(self, question: Question) -> None:
        """Ask, and return at once. Raises `NotConnectedError` where standard input is no terminal."""
        terminal = _terminal()
        if terminal is None:
            words = "there is no operator to ask: standard input is no terminal"
            raise NotConnectedError(question.device, words, "run it at a terminal, or in the daemon (bscd serve)")
        threading.Thread(target=self._talk, args=(question, terminal), name="operator", daemon=True).start()

    def tell(self, device: str, text: str) -> None:
        """Show a message."""
        typer.echo(f"{device}: {text}", err=True)

    def _talk(self, question: Question, terminal: int) -> None:
        with self._talking:  # until the one before is answered or withdrawn
            with suppress(termios.error):
                termios.tcflush(terminal, termios.TCIFLUSH)  # what was typed before is no answer
            try:
                typer.echo(question.text, err=True)
                while (line := self._line(question, terminal)) is not None:
                    _take(question, line)
            except (OSError, ValueError):  # the terminal is gone, or closed
                question.withdraw()

    def _line(self, question: Question, terminal: int) -> str | None:
        """What was typed; None when nothing is to be asked any more."""
        if question.state is not QuestionState.OPEN:
            return None
        proposal = "" if question.proposal is None else f" [{question.proposal:g}]"
        typer.echo(f"{question.unit}{proposal}: ", err=True, nl=False)
        while question.state is QuestionState.OPEN:
            if self._stop.is_set():
                question.withdraw()
            elif select.select([terminal], [], [], LOOK_S)[0]:
                typed = _read(terminal)
                if typed:
                    return typed.decode(errors="replace").strip()
                question.withdraw()
        typer.echo("withdrawn", err=True)
        return None


def _terminal() -> int | None:
    """Standard input's number where it is a terminal."""
    try:
        number = sys.stdin.fileno()
    except (AttributeError, OSError, ValueError):  # closed, or none at all
        return None
    return number if os.isatty(number) else None


def _read(terminal: int) -> bytes:
    """A line, empty at the end of the input or when the terminal is gone."""
    try:
        return os.read(terminal, LINE_BYTES)
    except OSError:
        return b""


def _take(question: Question, line: str) -> None:
    """Answer with what was typed, or say why it is no answer."""
    try:
        if line:
            value = float(line)
        elif question.proposal is not None:
            value = question.proposal
        else:
            raise ValueError
    except ValueError:
        typer.echo(f"{question.device}: {line!r} is no number; type one in {question.unit}", err=True)
        return
    try:
        question.answer(value)
    except ValueError as error:
        typer.echo(str(error), err=True)
