"""Progress: plain lines where nobody watches, a bar on a terminal."""

import io

import pytest
from rich.console import Console

from bscd.cli.progress import progress


def _run(*, terminal: bool, fail_at: int | None = None) -> str:
    out = io.StringIO()
    console = Console(file=out, force_terminal=terminal, width=120)
    with progress("Reference scan", total=3, unit="positions", console=console) as step:
        for k in (-1, 0, 1):
            if k == fail_at:
                raise RuntimeError("stopped")
            step(1, f"POS.{k:+d}")
    return out.getvalue()


def test_plain_lines_say_what_is_begun_and_done():
    lines = _run(terminal=False).splitlines()
    assert lines[0] == "Reference scan: 3 positions"
    assert lines[-1].startswith("Reference scan: 3/3 positions POS.+1 (")
    assert not any("\x1b" in line for line in lines)


def test_a_terminal_gets_a_bar():
    shown = _run(terminal=True)
    assert "\x1b[" in shown
    assert "3/3" in shown


@pytest.mark.parametrize("terminal", [False, True])
def test_an_error_passes_through(terminal):
    with pytest.raises(RuntimeError, match="stopped"):
        _run(terminal=terminal, fail_at=0)
