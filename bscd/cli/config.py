"""`bscd config`: check a configuration, print its schema."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from bscd.config import config_schema, load_config


def register(app: typer.Typer) -> None:
    """Add the command group."""
    group = typer.Typer(help="Check a rig's configuration.", no_args_is_help=True)
    app.add_typer(group, name="config")

    @group.command()
    def check(file: Annotated[Path, typer.Argument(help="The TOML file.")]) -> None:
        """Validate a configuration; every problem is one line.

        Example: bscd config check config/twin.toml
        """
        config = load_config(file)
        typer.echo(f"{file}: valid, rig {config.rig.name!r}")

    @group.command()
    def schema() -> None:
        """Print the JSON schema of a configuration, with the options of every installed driver.

        Example: bscd config schema > rig.schema.json
        """
        typer.echo(json.dumps(config_schema(), indent=2))
