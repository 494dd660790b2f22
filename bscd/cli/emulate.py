"""`bscd emulate`: the twin behind its real wire protocols, so that drivers and the makers' tools have a rig."""

from __future__ import annotations

import signal
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from bscd.composition import build_world
from bscd.config import RigConfig, load_config
from bscd.config.load import DEVICE_KINDS
from bscd.errors import InputError
from drivers.clock import Clock, HostClock
from drivers.emulators.rig import FIRST_PORT, EmulatedRig, StageProtocol, smallest_step
from drivers.registry import DriverContext, installed_drivers

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


def emulated_devices(config: RigConfig, clock: Clock, world: Any, stages: StageProtocol) -> dict[str, Any]:
    """Simulated devices for a configuration's names, its stages as fine as their controllers count."""
    registry = installed_drivers()
    devices: dict[str, Any] = {}
    for name, kind in DEVICE_KINDS.items():
        driver = f"{kind}.simulated"
        section = getattr(config.devices, name)
        if section is None:
            devices[name] = None
            continue
        given = section.options.model_dump() if section.driver == driver else {}
        if kind == "camera":
            given = {"camera": name, **given}
        if kind == "axis":
            quantity = {"jacks": "jack"}.get(name, name)
            given = {"quantity": quantity, **given}
            if name in ("rotation", "translation"):
                unit = "deg" if name == "rotation" else "mm"
                given[f"resolution_{unit}"] = smallest_step(name, stages)
        devices[name] = registry[driver].build(given, DriverContext(name, clock, world))
    return devices


def real_configuration(text: str, devices: Mapping[str, Mapping[str, Any]]) -> str:
    """A configuration's text with other devices and without the twin: what is behind real drivers is not simulated."""
    kept, skipping = [], False
    for line in text.splitlines():
        if line.startswith("["):
            skipping = line.startswith(("[devices", "[twin"))
        if not skipping:
            kept.append(line)
    for name, section in devices.items():
        kept += ["", *_section(f"devices.{name}", section)]
    return "\n".join(kept).strip() + "\n"


def _section(name: str, values: Mapping[str, Any]) -> list[str]:
    tables = {key: value for key, value in values.items() if isinstance(value, Mapping)}
    lines = [f"[{name}]", *(f"{key} = {_toml(value)}" for key, value in values.items() if key not in tables)]
    for key, table in tables.items():
        lines += ["", *_section(f"{name}.{key}", table)]
    return lines


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml(one) for one in value) + "]"
    return repr(value)
