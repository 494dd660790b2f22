"""`bscd status` and `bscd estop`."""

from __future__ import annotations

from typing import Annotated

import typer

from bscd.cli.remote.connection import URL, Url, client_at
from bscd.cli.remote.telling import job_line
from bscd.daemon.documents import DeviceDocument, StatusDocument
from bscd.errors import CheckFailedError


def register(app: typer.Typer) -> None:
    """Add the commands."""

    @app.command()
    def status(
        url: Url = URL,
        json: Annotated[bool, typer.Option("--json", help="The whole document, for programs.")] = False,
    ) -> None:
        """What the rig is doing.

        Example: bscd status
        """
        with client_at(url) as client:
            now = client.status()
        if json:
            typer.echo(now.model_dump_json(indent=2))
            return
        for line in _lines(now):
            typer.echo(line)

    @app.command()
    def estop(
        url: Url = URL,
        reset: Annotated[bool, typer.Option("--reset", help="Let things move again; nothing does by itself.")] = False,
        reason: Annotated[str, typer.Option(help="Why; kept in the journal.")] = "",
    ) -> None:
        """Stop every axis and vent, now; by the e-stop's own address (BSCD_ESTOP_URL) where the API does not do it.

        Example: bscd estop --reason "it smells"
        """
        with client_at(url, stops=not reset) as client:
            if reset:
                typer.echo(f"reset; the rig is {client.reset_estop().state.value}")
                return
            done = client.estop(reason)
        typer.echo(f"e-stop: every stop command was given within {done.took_ms or 0.0:.1f} ms; latched until a reset")
        if done.failures:
            raise CheckFailedError(f"not all stopped, act by hand: {'; '.join(done.failures)}")


def _lines(now: StatusDocument) -> list[str]:
    lines = [f"{now.rig}: {now.state.value}" + (f" ({now.reason})" if now.reason else "")]
    if now.estop.latched:
        lines.append(f"e-stop latched by {now.estop.by}; bscd estop --reset lets things move again")
    if now.job is not None:
        lines.append(job_line(now.job))
    if now.queue or now.desk:
        lines.append(f"waiting: {len(now.queue)} for the bench, {len(now.desk)} at the desk")
    if now.lease is not None:
        lines.append(f"in control: {now.lease.holder} until {now.lease.until:%H:%M:%S} UTC")
    lines += [_device_line(device) for device in now.devices.values()]
    lines.append(f"disk: {now.disk_free_bytes / 1e9:.1f} GB free")
    return lines


def _device_line(device: DeviceDocument) -> str:
    told = "not connected" if not device.connected else ""
    if device.connected and device.reading is not None:
        told = f"{device.reading:.3f} {device.unit}"
    if device.homed is False:
        told += ", not homed"
    if device.moving:
        told += ", moving"
    return f"  {device.name:<12} {told or 'connected'}" + (f"; {device.problem}" if device.problem else "")
