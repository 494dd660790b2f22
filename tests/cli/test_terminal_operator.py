"""The person at a command's terminal: what is typed, what is refused, and what ends a question."""

import os
import threading
import time

import pytest

from bscd.cli.terminal_operator import TerminalOperator
from drivers.clock import HostClock
from drivers.errors import NotConnectedError
from drivers.interfaces import Range
from drivers.operator import Question, QuestionState

PATIENCE_S = 10.0


@pytest.fixture
def typist(monkeypatch):
    """The other end of the terminal that standard input is."""
    outer, inner = os.openpty()
    stdin = os.fdopen(inner)
    monkeypatch.setattr("sys.stdin", stdin)
    yield outer
    stdin.close()
    os.close(outer)


@pytest.fixture
def stop():
    return threading.Event()


@pytest.fixture
def operator(stop):
    return TerminalOperator(stop)


def question(proposal=None):
    return Question("jacks", "jacks: what height do both jacks show?", "mm", Range(0.0, 84.0), proposal)


class Screen:
    """What stands on stderr so far."""

    def __init__(self, capsys):
        self._capsys = capsys
        self.text = ""

    def shows(self, words, times=1):
        deadline_s = time.monotonic() + PATIENCE_S
        while self.text.count(words) < times:
            assert time.monotonic() < deadline_s, f"{words!r} is not shown: {self.text!r}"
            time.sleep(0.01)
            self.text += self._capsys.readouterr().err
        return True


@pytest.fixture
def screen(capsys):
    return Screen(capsys)


def ended(asked):
    return asked.wait(HostClock(), PATIENCE_S)


def test_a_height_is_asked_for_and_typed(operator, typist, screen):
    asked = question()
    operator.ask(asked)
    assert screen.shows("jacks: what height do both jacks show?\nmm: ")
    os.write(typist, b"41.5\n")
    assert (ended(asked), asked.value) == (QuestionState.ANSWERED, 41.5)


def test_an_empty_line_confirms_what_was_asked_for(operator, typist, screen):
    asked = question(proposal=70.0)
    operator.ask(asked)
    assert screen.shows("mm [70]: ")
    os.write(typist, b"\n")
    assert (ended(asked), asked.value) == (QuestionState.ANSWERED, 70.0)


def test_what_is_no_answer_is_said_and_asked_again(operator, typist, screen):
    asked = question()
    operator.ask(asked)
    wrong = {
        "seven": "'seven' is no number; type one in mm",
        "": "'' is no number; type one in mm",
        "90": "90 mm can not be; it must be from 0 to 84 mm",
        "nan": "nan mm can not be",
    }
    for number, (typed, said) in enumerate(wrong.items(), start=1):
        assert screen.shows("mm: ", times=number)
        os.write(typist, f"{typed}\n".encode())
        assert screen.shows(f"jacks: {said}")
    assert asked.state is QuestionState.OPEN
    os.write(typist, b"7\n")
    assert (ended(asked), asked.value) == (QuestionState.ANSWERED, 7.0)


def test_what_was_typed_before_is_no_answer(operator, typist, screen):
    os.write(typist, b"12\n")
    asked = question()
    operator.ask(asked)
    assert screen.shows("mm: ")
    os.write(typist, b"13\n")
    assert (ended(asked), asked.value) == (QuestionState.ANSWERED, 13.0)


@pytest.mark.parametrize("ending", ["stop", "end of input", "withdrawn"])
def test_a_question_ends_without_an_answer(operator, typist, screen, stop, ending):
    asked = question()
    operator.ask(asked)
    assert screen.shows("mm: ")
    if ending == "stop":
        stop.set()
    elif ending == "end of input":
        os.write(typist, b"\x04")
    else:
        asked.withdraw()
    assert ended(asked) is QuestionState.WITHDRAWN
    assert screen.shows("withdrawn")


def test_a_question_that_can_not_be_shown_is_withdrawn(operator, typist, monkeypatch):
    monkeypatch.setattr("typer.echo", gone)
    asked = question()
    operator.ask(asked)
    assert ended(asked) is QuestionState.WITHDRAWN


def gone(*_args, **_options):
    raise OSError(5, "Input/output error")


def test_the_next_question_waits_for_the_end_of_the_one_before(operator, typist, screen):
    first, second = question(), question(proposal=5.0)
    operator.ask(first)
    assert screen.shows("mm: ")
    first.withdraw()
    operator.ask(second)
    assert screen.shows("mm [5]: ")
    os.write(typist, b"\n")
    assert (ended(second), second.value) == (QuestionState.ANSWERED, 5.0)
    assert first.value is None


def test_without_a_terminal_nobody_is_asked(operator, monkeypatch, capsys):
    with open(os.devnull) as nothing:
        for stdin in (nothing, None):
            monkeypatch.setattr("sys.stdin", stdin)
            with pytest.raises(NotConnectedError, match="jacks: there is no operator to ask: standard input is no"):
                operator.ask(question())
    operator.tell("pressure", "vent")
    assert capsys.readouterr().err == "pressure: vent\n"
