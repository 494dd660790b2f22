"""`bscd devices`: what is there, what is configured, what answers, and what is wrong with what does not."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from bscd.composition import build_world
from bscd.config import DeviceConfig, RigConfig, load_config
from bscd.config.load import DEVICE_KINDS
from drivers.clock import HostClock
from drivers.errors import DeviceError
from drivers.interfaces import Axis, Camera, PressureSource
from drivers.operator import Question
from drivers.ports import serial_ports
from drivers.registry import DriverContext, installed_drivers

DEFAULT_CONFIG = Path(__file__).resolve().parents[2] / "config/twin.toml"


class Onlooker:
    """A `drivers.operator.Operator` for whom there is nothing to do: a look asks nothing and leaves the rig alone."""

    def ask(self, question: Question) -> None:
        """Answer nothing."""
        question.withdraw()

    def tell(self, device: str, text: str) -> None:
        """Pass nothing on: what a driver has the operator do when it closes is for who works with it."""


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def devices(
        config: Annotated[Path, typer.Option(help="The rig's configuration.")] = DEFAULT_CONFIG,
        found: Annotated[bool, typer.Option(help="List what can be seen as well.")] = True,
    ) -> None:
        """Connect to every configured device and say what answers; nothing changes. Exit code 1 if one does not.

        What another program does with the rig goes on.

        Example: bscd devices --config rig.toml
        """
        chosen = load_config(config)
        if found:
            for line in seen():
                typer.echo(line)
            typer.echo("")
        typer.echo(f"configured in {config} ({chosen.rig.name}):")
        answers = configured(chosen)
        for line, _ in answers:
            typer.echo(line)
        if not all(well for _, well in answers):
            raise typer.Exit(1)


def seen() -> list[str]:
    """What the installed drivers can see, and which of them can not be loaded."""
    registry = installed_drivers()
    lines = ["seen:"]
    for name, entry in sorted(registry.items()):
        if entry.find is None:
            continue
        try:
            there = entry.find()
        except DeviceError as error:
            lines.append(f"  {name:<20} can not look: {error}")
            continue
        lines += [f"  {name:<20} {one}" for one in there] or [f"  {name:<20} none"]
    ports = serial_ports()
    lines += [f"  {'serial port':<20} {port}" for port in ports] or [f"  {'serial port':<20} none"]
    lines += [f"  {name:<20} can not be loaded: {why}" for name, why in sorted(registry.broken.items())]
    return lines


def configured(config: RigConfig) -> list[tuple[str, bool]]:
    """A line for each configured device, and whether it answers well; all are asked at once."""
    clock = HostClock()
    world = build_world(config, clock)
    try:
        sections = {name: getattr(config.devices, name) for name in DEVICE_KINDS}
        there = {name: section for name, section in sections.items() if section is not None}
        with ThreadPoolExecutor(len(there), thread_name_prefix="devices") as pool:
            asked = {name: pool.submit(_ask, name, section, clock, world) for name, section in there.items()}
        lines = [one.result() for one in asked.values()]
        lines += [(f"  {name:<12} not configured", True) for name in sections if name not in there]
        return lines
    finally:
        if world is not None:
            world.close()


def _ask(name: str, section: DeviceConfig, clock: HostClock, world: Any) -> tuple[str, bool]:
    begin = f"  {name:<12} {section.driver:<20} "
    device = None
    try:
        context = DriverContext(name, clock, world, Onlooker())
        device = installed_drivers()[section.driver].factory(section.options, context)
        device.connect()
        text, well = _told(device)
        return begin + text, well
    except DeviceError as error:
        hint = f"; {error.hint}" if error.hint else ""
        return f"{begin}NO ANSWER: {error.doing}{hint}", False
    finally:
        # an axis is stopped by its closing, whoever moves it: its line ends with this process
        if device is not None and not isinstance(device, Axis):
            with suppress(DeviceError):
                device.close()


def _told(device: Any) -> tuple[str, bool]:
    """What a connected device says of itself, and whether it is well."""
    info = device.info()
    identity = " ".join(part for part in (info.vendor, info.model) if part) + f", serial {info.serial or 'not told'}"
    if info.firmware:
        identity += f", firmware {info.firmware}"
    if isinstance(device, Camera):
        status = device.status()
        size = f"{info.width_px} x {info.height_px} px, {info.bit_depth} bit"
        return f"answers: {identity}; {size}, {status.exposure_s * 1e3:g} ms, {status.gain_db:g} dB", True
    if isinstance(device, PressureSource):
        return f"answers: {identity}; {device.read().pressure_kpa:.3f} kPa", True
    status = device.status()
    where = f"{status.position:g} {info.unit}" if status.homed else "not homed"
    state = f"; FAULT: {status.fault}" if status.fault else ""
    return f"answers: {identity}; {where}, limits {info.limits.low:g} to {info.limits.high:g}{state}", not status.fault
