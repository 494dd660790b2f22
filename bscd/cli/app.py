"""The `bscd` command: collects the commands and turns errors into one line and an exit code."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from bscd.errors import BscdError
from bscd.version import __version__
from drivers.errors import DeviceError

#: Modules with a ``register(app)`` of their own and the commands that each adds, in the order of ``bscd --help``.
COMMANDS: dict[str, tuple[str, ...]] = {
    "demo": ("demo",),
    "serve": ("serve",),
    "import_": ("import",),
    "calibrate": ("calibrate",),
    "measure": ("measure",),
    "export": ("export",),
    "record": ("record",),
    "recover": ("recover",),
    "devices": ("devices",),
    "emulate": ("emulate",),
    "config": ("config",),
    "design": ("design",),
    "remote.status": ("status", "estop"),
    "remote.run": ("run",),
    "remote.jobs": ("jobs", "pause", "resume", "stop", "abort", "confirm"),
    "remote.files": ("runs", "download"),
    "keys": ("keys",),
}

DONE, FAILED = 0, 1


def build_app(arguments: Sequence[str] = ()) -> typer.Typer:
    """The command line; with one command alone where ``arguments`` name it, since each loads its libraries."""
    app = typer.Typer(
        name="bscd",
        help="Measure with a biprism single-camera stereo-DIC rig.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode="markdown",
    )

    @app.callback()
    def root(
        version: Annotated[
            bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=_print_version)
        ] = False,
    ) -> None:
        pass

    first = set(arguments[:1])
    named = [module for module, commands in COMMANDS.items() if first & set(commands)]
    for name in [] if first == {"--version"} else named or COMMANDS:
        importlib.import_module(f"bscd.cli.{name}").register(app)
    return app


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"bscd {__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command line; exit code 0 done, 1 failed, 2 bad usage."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run a command line and return its exit code; errors go to stderr, one line each."""
    try:
        build_app(arguments)(arguments, prog_name="bscd")
    except SystemExit as ended:  # usage errors, Ctrl-C and the end of a command are turned into codes by typer
        return ended.code if isinstance(ended.code, int) else DONE
    except (BscdError, DeviceError, OSError) as err:
        for line in str(err).splitlines():
            print(f"error: {line}", file=sys.stderr)
        return FAILED
    return DONE
