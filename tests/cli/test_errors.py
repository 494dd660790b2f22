"""Every error ends a command with its own code and with one line a problem."""

import pytest

from bscd.cli import app as command_line
from bscd.cli.app import run
from bscd.errors import CheckFailedError, InputError
from drivers.errors import OutOfLimitsError


@pytest.fixture
def failing(monkeypatch):
    """Makes `bscd config check` raise the error that it is called with."""
    monkeypatch.setattr(command_line, "COMMANDS", {"config": ("config",)})

    def arrange(error: BaseException) -> None:
        def check(path):
            raise error

        monkeypatch.setattr("bscd.cli.config.load_config", check)

    return arrange


@pytest.mark.parametrize(
    ("error", "lines"),
    [
        (InputError("a.toml: one\na.toml: two"), ["error: a.toml: one", "error: a.toml: two"]),
        (CheckFailedError("POS.-3: 4 dots missing"), ["error: POS.-3: 4 dots missing"]),
        (
            OutOfLimitsError("jacks", "moving to 90 mm", "stay below 84"),
            ["error: jacks: moving to 90 mm; stay below 84"],
        ),
        (FileNotFoundError(2, "No such file", "x.h5"), ["error: [Errno 2] No such file: 'x.h5'"]),
    ],
    ids=["input", "check", "device", "system"],
)
def test_a_failure_is_told_and_ends_with_1(failing, capsys, error, lines):
    failing(error)
    assert run(["config", "check", "a.toml"]) == 1
    assert capsys.readouterr().err.splitlines() == lines


def test_a_mistake_of_our_own_is_not_hidden(failing):
    failing(ZeroDivisionError("a bug"))
    with pytest.raises(ZeroDivisionError):
        run(["config", "check", "a.toml"])


@pytest.mark.parametrize("arguments", [["config"], ["config", "check"], ["config", "schema", "--deep"], ["confgi"]])
def test_bad_usage_ends_with_2(monkeypatch, capsys, arguments):
    monkeypatch.setattr(command_line, "COMMANDS", {"config": ("config",)})
    assert run(arguments) == 2
    told = capsys.readouterr()
    assert "Usage" in told.out + told.err


def test_an_interrupt_ends_with_1(failing):
    failing(KeyboardInterrupt())
    assert run(["config", "check", "a.toml"]) in (1, 130)


def test_a_command_does_not_wait_for_the_libraries_of_others(monkeypatch, capsys):
    monkeypatch.setattr(command_line, "COMMANDS", {"config": ("config",), "not_there": ("not_there",)})
    assert run(["config", "schema"]) == 0
    with pytest.raises(ModuleNotFoundError):
        run(["--help"])
