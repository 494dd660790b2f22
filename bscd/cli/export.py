"""`bscd export`: results for spreadsheets, ParaView and MATLAB."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import typer

from bscd.cli.following import following
from bscd.procedures import Progress
from bscd.results import ResultsFile
from bscd.results.export import ExportProgress, export_csv, export_matlab, export_vtk

ExportFormat = Literal["csv", "vtk", "mat"]
Exporter = Callable[[ResultsFile, Path, ExportProgress | None], tuple[Path, ...]]

EXPORTERS: dict[ExportFormat, Exporter] = {"csv": export_csv, "vtk": export_vtk, "mat": export_matlab}


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def export(
        results: Annotated[Path, typer.Argument(help="The results file, made by bscd measure.")],
        folder: Annotated[Path, typer.Argument(help="The folder to write to; nothing in it is overwritten.")],
        to: Annotated[
            ExportFormat,
            typer.Option(
                help="csv: a table a frame; vtk: a surface a frame for ParaView; mat: MultiDIC's DIC3DPPresults."
            ),
        ],
    ) -> None:
        """Write results as files for spreadsheets (csv), ParaView (vtk) or MATLAB and MultiDIC (mat).

        Example: bscd export results.h5 --to csv tables
        """
        with ResultsFile(results) as measured, following("Export", "frames") as report:
            count, points = len(measured), len(measured.points_px)
            if not measured.complete:
                typer.echo(
                    f"warning: {results} is not complete ({_why(measured)}); what it holds is exported", err=True
                )
            made = EXPORTERS[to](measured, folder, lambda done, total, doing: report(Progress(done, total, doing)))
        names = [path.name for path in made]
        files = f"{len(names)} files, {names[0]} to {names[-1]}" if len(names) > 1 else names[0]
        typer.echo(f"{folder}: {count} frames of {points} points in {files}")


def _why(measured: ResultsFile) -> str:
    return measured.reason or "it is being measured, or measuring crashed"
