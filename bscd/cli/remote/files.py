"""`bscd runs` and `bscd download`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from bscd.cli.remote.connection import URL, Url, client_at
from bscd.daemon.documents import FileDocument

Kind = Literal["run", "calibration", "result", "report"]


def register(app: typer.Typer) -> None:
    """Add the commands."""

    @app.command()
    def runs(
        kind: Annotated[Kind, typer.Option(help="What to list.")] = "run",
        url: Url = URL,
    ) -> None:
        """List runs, calibrations, results or reports of a daemon, the newest first.

        Example: bscd runs --kind calibration
        """
        with client_at(url) as client:
            for document in client.files(kind):
                typer.echo(_line(document))

    @app.command()
    def download(
        name: Annotated[str, typer.Argument(help="As bscd runs lists it.")],
        out: Annotated[Path | None, typer.Option("-o", "--out", help="The file to make; default: its name.")] = None,
        kind: Annotated[Kind, typer.Option(help="What it is.")] = "run",
        file: Annotated[str, typer.Option(help="Of a report: which of its files.")] = "report.html",
        url: Url = URL,
    ) -> None:
        """Fetch a run, calibration, result or report; one that was cut off goes on where it ended.

        Example: bscd download inflation-20261126-101500-a1b2 -o inflation.h5
        """
        to = out or Path(file if kind == "report" else f"{name}.h5")
        with client_at(url) as client:
            path = client.download(kind, name, to, file=file)
        typer.echo(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


def _line(document: FileDocument) -> str:
    shown = [name for name in ("title", "frames", "state") if name in document.about]
    told = ", ".join(f"{name} {document.about[name]}" for name in shown)
    problem = f"; {document.problem}" if document.problem else ""
    return f"{document.name}  {document.bytes / 1e6:.1f} MB  {told}{problem}"
