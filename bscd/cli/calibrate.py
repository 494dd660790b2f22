"""`bscd calibrate`: a calibration from two run files, offline."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bscd.calibration import Calibration, CalibrationChoices
from bscd.calibration.choices import Interpolant, ReferenceKind, ShiftSolver, TriangulationMethod
from bscd.cli.following import following
from bscd.errors import InputError
from bscd.offline import calibrate_files


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def calibrate(
        reference: Annotated[Path, typer.Argument(help="Run file with the reference scan, biprism lowered.")],
        bsc: Annotated[Path, typer.Argument(help="Run file with the biprism scan; may be the same file.")],
        out: Annotated[Path, typer.Option("-o", "--out", help="The calibration file to make; it must not exist.")],
        reference_points: Annotated[
            ReferenceKind, typer.Option("--reference", help="Source of the reference points.")
        ] = "lattice",
        solver: Annotated[ShiftSolver, typer.Option(help="How the image shifts are found.")] = "projection",
        interpolant: Annotated[Interpolant, typer.Option(help="How the maps fill the volume.")] = "smooth",
        triangulation: Annotated[TriangulationMethod, typer.Option(help="How points are triangulated.")] = "optimal",
        degree: Annotated[int, typer.Option(min=1, max=4, help="Total degree of the smooth maps.")] = 4,
    ) -> None:
        """Calibrate the biprism system from its two scans.

        The target's geometry comes from the run files' configuration.

        Example: bscd calibrate reference.h5 bsc.h5 -o calibration.h5
        """
        if out.exists():
            raise InputError(f"{out}: exists already; calibrations are never overwritten, choose another name")
        choices = CalibrationChoices(reference_points, solver, interpolant, triangulation, degree)
        with following("Calibration", "images") as progress:
            made = calibrate_files(reference, bsc, choices, progress=progress, warn=_warn)
        made.save(out)
        for line in describe(made):
            typer.echo(line)
        typer.echo(f"{out}: checksum {made.checksum}")


def _warn(text: str) -> None:
    typer.echo(f"warning: {text}", err=True)


def describe(calibration: Calibration) -> list[str]:
    """What a calibration is worth, a line each."""
    figures = calibration.figures
    return [
        f"standard stereo error {figures['standard_stereo_error_mean_mm']:.4f} +- "
        f"{figures['standard_stereo_error_std_mm']:.4f} mm over {figures['standard_stereo_points']:.0f} points",
        f"maps from {figures['control_points']:.0f} control points at {figures['positions']:.0f} positions, "
        f"residual {figures['map_residual_rms_px']:.4f} px rms; {calibration.choices.reference} reference, "
        f"{calibration.choices.solver} shifts, {calibration.choices.interpolant} maps, "
        f"{calibration.choices.triangulation} triangulation",
    ]
