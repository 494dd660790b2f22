"""`bscd keys`: who may talk to the daemon from elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from bscd.config import load_config
from bscd.daemon.keys import KeyStore

DEFAULT_CONFIG = Path(__file__).resolve().parents[2] / "config/twin.toml"

Config = Annotated[Path, typer.Option(help="The daemon's configuration.")]
Data = Annotated[Path | None, typer.Option(help="The daemon's data folder, where it was given to bscd serve.")]


def register(app: typer.Typer) -> None:
    """Add the commands."""
    keys = typer.Typer(help="Keys for other computers, kept as hashes in the data folder.", no_args_is_help=True)

    @keys.command()
    def add(
        name: Annotated[str, typer.Argument(help="Whose key it is.")],
        role: Annotated[
            Literal["viewer", "operator", "admin"], typer.Option(help="viewer looks, operator works, admin does all.")
        ] = "viewer",
        config: Config = DEFAULT_CONFIG,
        data: Data = None,
    ) -> None:
        """Make a key; it is shown once.

        Example: bscd keys add anna --role operator --config rig.toml
        """
        key = _store(config, data).add(name, role)
        typer.echo(f"the key of {name} ({role}); it is not shown again:", err=True)
        typer.echo(key)

    @keys.command(name="list")
    def list_keys(config: Config = DEFAULT_CONFIG, data: Data = None) -> None:
        """Who has keys.

        Example: bscd keys list --config rig.toml
        """
        store = _store(config, data)
        for kept in store.list():
            typer.echo(f"{kept.name:<24} {kept.role:<10} since {kept.created_at:%Y-%m-%d %H:%M} UTC")
        if store.empty:
            typer.echo(f"none in {store.path}")

    @keys.command()
    def revoke(
        name: Annotated[str, typer.Argument(help="Whose key.")], config: Config = DEFAULT_CONFIG, data: Data = None
    ) -> None:
        """Have a key open nothing any more, at once, also of a daemon that runs.

        Example: bscd keys revoke anna --config rig.toml
        """
        _store(config, data).revoke(name)
        typer.echo(f"the key of {name} opens nothing any more")

    app.add_typer(keys, name="keys")


def _store(config: Path, data: Path | None) -> KeyStore:
    settings = load_config(config).daemon
    folder = data or config.absolute().parent / settings.data_folder
    return KeyStore(folder / settings.keys_file)
