"""Show a procedure's progress on the command line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from bscd.cli.progress import Step, progress
from bscd.procedures import Progress, ProgressCallback


@contextmanager
def following(title: str, unit: str = "positions") -> Iterator[ProgressCallback]:
    """A callback for a procedure; the bar appears with its first call, when the total is known.

    A procedure of several parts (totals that begin anew) gets a bar for each.
    """
    with ExitStack() as shown:
        step: Step | None = None
        done = total = 0

        def report(now: Progress) -> None:
            nonlocal step, done, total
            if step is None or now.total != total or now.done < done:
                shown.close()
                name, _, rest = now.doing.partition(": ")
                step = shown.enter_context(progress(f"{title}, {name}" if rest else title, now.total, unit))
                done, total = 0, now.total
            step(now.done - done, now.doing.rpartition(": ")[2])
            done = now.done

        yield report
