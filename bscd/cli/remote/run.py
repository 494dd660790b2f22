"""`bscd run`: a recipe or a campaign on the rig of a running daemon."""

from __future__ import annotations

import json as json_format
import signal
import sys
from types import FrameType
from typing import Annotated, Any

import typer

from bscd.cli.remote.connection import URL, Url, client_at
from bscd.cli.remote.telling import ending_lines, job_line, progress_text
from bscd.client import Client
from bscd.daemon.campaigns import load_recipe, recipe_of
from bscd.daemon.documents import JobDocument, JobStatus
from bscd.errors import BscdError, CheckFailedError, InputError


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def run(
        recipe: Annotated[str, typer.Argument(help="A recipe's name (home, bsc-scan, ...), or a TOML or YAML file.")],
        settings: Annotated[
            list[str] | None, typer.Option("--set", help="KEY=VALUE of the recipe; a.b reaches inside. Repeat it.")
        ] = None,
        follow: Annotated[bool, typer.Option("--follow", help="Stay until it ends; Ctrl-C stops it.")] = False,
        check: Annotated[bool, typer.Option("--check", help="Only say what it would take; nothing moves.")] = False,
        key: Annotated[str | None, typer.Option(help="Idempotency-Key: the same key starts it once.")] = None,
        url: Url = URL,
    ) -> None:
        """Put a recipe or a campaign in line.

        Example: bscd run config/campaigns/genovese2013.toml --follow
        """
        wanted = _recipe(recipe, settings or [])
        with client_at(url) as client:
            if check:
                _check(client, wanted)
                return
            job = client.submit(wanted, idempotency_key=key)
            typer.echo(job_line(job))
            if follow:
                end(follow_job(client, job.id))


def follow_job(client: Client, job_id: str) -> JobDocument:
    """Show a job up to its end; Ctrl-C stops it, a second one leaves it alone. Questions are answered at a terminal."""
    asked, warned, line, job = 0, 0, "", client.job(job_id)
    before = signal.getsignal(signal.SIGINT)

    def stop(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, before)
        typer.echo("stopping at the next safe point; Ctrl-C again leaves it running", err=True)
        client.stop(job_id)

    signal.signal(signal.SIGINT, stop)
    try:
        for job in client.follow(job_id):
            for text in job.warnings[warned:]:
                typer.echo(f"warning: {text}", err=True)
            warned = len(job.warnings)
            told = f"{job.status.value}  {progress_text(job)}"
            if told != line:
                line = told
                typer.echo(told, err=True)
            if job.prompt is not None and job.prompt.id != asked:
                asked = job.prompt.id
                _answer(client, job)
    finally:
        signal.signal(signal.SIGINT, before)
    return job


def end(job: JobDocument) -> None:
    """Say what came of it. Raises `CheckFailedError` unless it was done."""
    for line in ending_lines(job):
        typer.echo(line)
    if job.status is not JobStatus.DONE:
        raise CheckFailedError(f"job {job.id} {job.status.value}: {job.reason}")


def _answer(client: Client, job: JobDocument) -> None:
    prompt = job.prompt
    if prompt is None:
        return
    typer.echo(f"the rig asks: {prompt.text}", err=True)
    if not sys.stdin.isatty():
        typer.echo(f"answer it with: bscd confirm {job.id} {prompt.id}", err=True)
        return
    try:
        value = None
        if prompt.unit:
            value = typer.prompt(f"answer in {prompt.unit}", default=prompt.proposal, type=float, err=True)
        else:
            typer.prompt("done? press Enter", default="", show_default=False, err=True)
        client.confirm(job.id, prompt.id, value)
    except BscdError as error:
        typer.echo(f"warning: {error}", err=True)


def _check(client: Client, wanted: Any) -> None:
    would = client.validate(wanted)
    duration = "" if would.duration_s is None else f", {would.duration_s:.0f} s"
    typer.echo(f"{would.frames} frames, {would.disk_bytes / 1e6:.0f} MB{duration}")
    for axis, limits in would.limits.items():
        typer.echo(
            f"  {axis}: {limits['least']:g} to {limits['greatest']:g} (limits {limits['low_limit']:g} to "
            f"{limits['high_limit']:g})"
        )
    if not would.ok:
        raise CheckFailedError(f"it can not start: {'; '.join(would.problems)}")


def _recipe(name: str, settings: list[str]) -> Any:
    changes: dict[str, Any] = {}
    for setting in settings:
        path, equals, text = setting.partition("=")
        if not equals or not path:
            raise InputError(f"--set {setting}: is no KEY=VALUE; for example --set frames=4")
        place = changes
        *parents, last = path.split(".")
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = _value(text)
    if name.endswith((".toml", ".yaml", ".yml", ".json")):
        return load_recipe(name, changes)
    return recipe_of({"recipe": name, **changes}, f"bscd run {name}")


def _value(text: str) -> Any:
    try:
        return json_format.loads(text)
    except ValueError:
        return text


__all__ = ["end", "follow_job", "register"]
