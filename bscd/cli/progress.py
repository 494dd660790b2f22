"""Progress of a long job: a bar on a terminal, plain lines otherwise."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

Step = Callable[[int, str], None]
"""Call with how much was done and a word on what."""

_QUIET_S = 2.0  # plain lines come no faster


@contextmanager
def progress(title: str, total: int, unit: str = "steps", console: Console | None = None) -> Iterator[Step]:
    """Report the progress of a job of ``total`` units on stderr.

    >>> with progress("Reference scan", total=17, unit="positions") as step:
    ...     step(1, "POS.-8")
    """
    console = console or Console(stderr=True)
    report = _bar if console.is_terminal else _lines
    with report(title, total, unit, console) as step:
        yield step


@contextmanager
def _bar(title: str, total: int, unit: str, console: Console) -> Iterator[Step]:
    columns = (
        TextColumn("{task.description:<22}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=console) as bars:
        task = bars.add_task(title, total=total, note="")
        yield lambda done, note="": bars.update(task, advance=done, note=note)


@contextmanager
def _lines(title: str, total: int, unit: str, console: Console) -> Iterator[Step]:
    started = last = time.monotonic()
    count = 0
    console.print(f"{title}: {total} {unit}", highlight=False, soft_wrap=True)

    def step(done: int, note: str = "") -> None:
        nonlocal count, last
        count += done
        now = time.monotonic()
        if now - last >= _QUIET_S or count >= total:
            last = now
            line = f"{title}: {count}/{total} {unit} {note}".rstrip()
            console.print(f"{line} ({now - started:.0f} s)", highlight=False, soft_wrap=True)

    yield step
