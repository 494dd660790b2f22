"""`bscd emulate`: the twin behind its real wire protocols, so that drivers and the makers' tools have a rig."""

from __future__ import annotations

import os
import select
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from bscd.composition import build_world
from bscd.composition.emulated import emulated_devices, real_configuration
from bscd.config import load_config
from bscd.errors import InputError
from drivers.clock import HostClock
from drivers.emulators.lines import PortTakenError
from drivers.emulators.orders import FaultOrders, OrderError
from drivers.emulators.rig import FIRST_PORT, PORTS, EmulatedRig, StageProtocol

DEFAULT_CONFIG = Path(__file__).resolve().parents[2] / "config/twin.toml"
LOOK_S = 0.3
"""How often the end is looked for."""


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def emulate(
        config: Annotated[Path, typer.Option(help="The twin to serve.")] = DEFAULT_CONFIG,
        stages: Annotated[
            StageProtocol, typer.Option(help="What the stages of --write-config speak; both are served.")
        ] = "ximc",
        first_port: Annotated[
            int, typer.Option(min=1024, max=65000, help=f"First of the {len(PORTS)} TCP ports.")
        ] = FIRST_PORT,
        write_config: Annotated[
            Path | None, typer.Option(help="Write a configuration with the real drivers for it into this new file.")
        ] = None,
    ) -> None:
        """Serve the digital twin behind GigE Vision, XIMC, Zaber and Modbus, until Ctrl-C.

        Example: bscd emulate --write-config emulated.toml

        Lines typed at it (or piped into it) put faults into it: `fault rotation silence 3` leaves the rotation stage
        without an answer for 3 s; `help` lists devices and faults. The end of its input does not end it.
        """
        if write_config is not None and write_config.exists():
            raise InputError(f"{write_config}: exists already; name a new file")
        chosen = load_config(config)
        clock = HostClock()
        world = build_world(chosen, clock)
        if world is None:
            raise InputError(f"{config}: an emulated rig needs a [twin] section; take config/twin.toml")
        rig = EmulatedRig(emulated_devices(chosen, clock, world), stages, first_port)
        ended = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: ended.set())
        try:
            for line in _start(rig, first_port):
                typer.echo(f"note: {line}", err=True)
            orders = FaultOrders(rig.devices_served, clock)
            for one in rig.served:
                typer.echo(f"{one.address:<28} {one.summary}")
            if write_config is not None:
                write_config.write_text(
                    real_configuration(config.read_text(encoding="utf-8"), rig.configuration()), encoding="utf-8"
                )
                typer.echo(f"{write_config}: a configuration with the real drivers for these")
            typer.echo("serving; Ctrl-C ends it, help lists the faults that can be typed")
            for line in _typed_lines(ended):
                _carry_out(orders, line)
            orders.close()
        finally:
            rig.stop()
            world.close()


def _start(rig: EmulatedRig, first_port: int) -> list[str]:
    """What could not be served. Raises `InputError` for a port that is taken."""
    try:
        return rig.start()
    except PortTakenError as err:
        last = first_port + len(PORTS) - 1
        raise InputError(
            f"{err}; end it, or take others than {first_port} to {last}, as with --first-port {last + 1}"
        ) from err


def _carry_out(orders: FaultOrders, line: str) -> None:
    try:
        done = orders.carry_out(line)
    except (OrderError, OSError) as err:
        typer.echo(f"error: {err}", err=True)
        return
    if done:
        typer.echo(done)


def _typed_lines(ended: threading.Event) -> Iterator[str]:
    """Lines of standard input until ``ended``; there may be no input, or an end of it, and it goes on without."""
    signal.signal(signal.SIGTTIN, signal.SIG_IGN)  # a shell's job in the background is not stopped for reading
    source, pending = _standard_input(), b""
    while not ended.is_set():
        if source is None or _is_another_jobs(source):
            ended.wait(LOOK_S)
            continue
        data = b""
        with suppress(OSError):
            if not select.select([source], [], [], LOOK_S)[0]:
                continue
            data = os.read(source, 4096)
        if not data:
            source, data = None, b"\n"
        *lines, pending = (pending + data).split(b"\n")
        yield from (line.decode(errors="replace") for line in lines)


def _standard_input() -> int | None:
    try:
        return None if sys.stdin is None else sys.stdin.fileno()
    except OSError:  # it is no file
        return None


def _is_another_jobs(terminal: int) -> bool:
    """Whether what is typed is meant for the shell, or for another of its jobs."""
    try:
        return os.tcgetpgrp(terminal) != os.getpgrp()
    except OSError:  # it is no terminal, or not ours
        return False
