"""`bscd demo`: the whole measurement on the built-in digital twin, in virtual time, held against its truth."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

DEFAULT_CONFIG = Path(__file__).resolve().parents[3] / "config/twin.toml"


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def demo(
        out: Annotated[Path, typer.Option(help="Folder for the report, the figures and the run files.")] = Path(
            "demo-out"
        ),
        config: Annotated[Path, typer.Option(help="Another twin than the built-in one.")] = DEFAULT_CONFIG,
    ) -> None:
        """Calibrate the digital twin, measure a sphere and an inflation; write report.html and summary.json.

        Example: bscd demo --out demo-out
        """
        begun = time.monotonic()
        from bscd.cli.demo.run import run_demo  # loads a second long, which bscd --help need not wait for
        from bscd.cli.demo.summary import told

        result = run_demo(out, config.read_text(encoding="utf-8"), str(config))
        for line in told(result.summary):
            typer.echo(line)
        typer.echo(f"{result.folder / 'report.html'} ({time.monotonic() - begun:.0f} s)")
