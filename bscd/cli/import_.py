"""`bscd import`: a folder of images and its manifest become a run file."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from bscd.acquisition import ImportResult, import_folder
from bscd.cli.progress import Step, progress
from bscd.config import parse_target


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command("import")
    def import_command(
        folder: Annotated[Path, typer.Argument(help="The folder with manifest.csv, rig.toml and the images.")],
        out: Annotated[Path, typer.Argument(help="The run file to make; it must not exist.")],
    ) -> None:
        """Make a run file of a folder of images and their manifest.csv.

        Every row and image is checked first; when any is bad all problems are told and nothing is written.

        Example: bscd import photographs run.h5
        """
        with ExitStack() as bars:
            result = import_folder(folder, out, progress=_Bar(bars), check_config=parse_target)
        for warning in result.warnings:
            typer.echo(f"warning: {warning}", err=True)
        typer.echo(_summary(result))


class _Bar:
    """Opens the progress bar once the work's size is known."""

    def __init__(self, bars: ExitStack) -> None:
        self._bars = bars
        self._step: Step | None = None
        self._done = 0

    def __call__(self, done: int, total: int, what: str) -> None:
        if self._step is None:
            self._step = self._bars.enter_context(progress("Import", total, unit="images read or written"))
        self._step(done - self._done, what)
        self._done = done


def _summary(result: ImportResult) -> str:
    parts = [f"{count} {phase} ({camera})" for (camera, phase), count in result.frames.items()]
    return f"{result.path}: {sum(result.frames.values())} frames: {', '.join(parts)}; uuid {result.uuid}"
