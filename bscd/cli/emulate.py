"""`bscd emulate`: the twin behind its real wire protocols, so that drivers and the makers' tools have a rig."""

from __future__ import annotations

import signal
import threading
from pathlib import Path
from typing import Annotated

import typer

from bscd.composition import build_world
from bscd.composition.emulated import emulated_devices, real_configuration
from bscd.config import load_config
from bscd.errors import InputError
from drivers.clock import HostClock
from drivers.emulators.rig import FIRST_PORT, EmulatedRig, StageProtocol

DEFAULT_CONFIG = Path(__file__).resolve().parents[2] / "config/twin.toml"


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def emulate(
        config: Annotated[Path, typer.Option(help="The twin to serve.")] = DEFAULT_CONFIG,
        stages: Annotated[StageProtocol, typer.Option(help="What the two stages speak.")] = "ximc",
        first_port: Annotated[int, typer.Option(min=1024, max=65000, help="First of the TCP ports.")] = FIRST_PORT,
        write_config: Annotated[
            Path | None, typer.Option(help="Write a configuration with the real drivers for it into this new file.")
        ] = None,
    ) -> None:
        """Serve the digital twin behind GigE Vision, XIMC or Zaber, and Modbus, until Ctrl-C.

        Example: bscd emulate --write-config emulated.toml
        """
        if write_config is not None and write_config.exists():
            raise InputError(f"{write_config}: exists already; name a new file")
        chosen = load_config(config)
        clock = HostClock()
        world = build_world(chosen, clock)
        if world is None:
            raise InputError(f"{config}: an emulated rig needs a [twin] section; take config/twin.toml")
        rig = EmulatedRig(emulated_devices(chosen, clock, world, stages), stages, first_port)
        ended = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: ended.set())
        try:
            for line in rig.start():
                typer.echo(f"note: {line}", err=True)
            for one in rig.served:
                typer.echo(f"{one.address:<28} {one.summary}")
            if write_config is not None:
                write_config.write_text(
                    real_configuration(config.read_text(encoding="utf-8"), rig.configuration()), encoding="utf-8"
                )
                typer.echo(f"{write_config}: a configuration with the real drivers for these")
            typer.echo("serving; Ctrl-C ends it")
            while not ended.wait(1.0):
                pass
        finally:
            rig.stop()
            world.close()
