"""`bscd recover`: repair a run that a crash cut off."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bscd.acquisition import recover_in_place, recover_into
from bscd.errors import CheckFailedError


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def recover(
        run: Annotated[Path, typer.Argument(help="Run file whose writer was killed, or that was cut off.")],
        out: Annotated[
            Path | None, typer.Option("-o", "--out", help="Write the whole frames into this new file instead.")
        ] = None,
    ) -> None:
        """Restore every flushed frame of a run whose recording was killed; its raw data is never rewritten.

        In its place only the mark of its writer is cleared. Into a copy everything up to the first damaged
        frame goes, also of a file whose end is missing.

        Example: bscd recover inflation.h5
        """
        recovery = recover_in_place(run) if out is None else recover_into(run, out)
        done = "restored" if recovery.changed else "are there, it needed no recovery"
        if recovery.damage:
            advice = "" if out is not None else f"; keep what is whole with bscd recover {run} --out COPY.h5"
            raise CheckFailedError(f"{recovery.damage} ({recovery.frames} frames {done}){advice}")
        typer.echo(f"{recovery.path}: {recovery.frames} frames {done}, all as recorded")
