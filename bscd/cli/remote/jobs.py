"""`bscd jobs`, `pause`, `resume`, `stop`, `abort` and `confirm`."""

from __future__ import annotations

from typing import Annotated

import typer

from bscd.cli.remote.connection import URL, Url, client_at
from bscd.cli.remote.run import end, follow_job
from bscd.cli.remote.telling import ending_lines, job_line
from bscd.client import Client
from bscd.daemon.documents import JobStatus
from bscd.errors import InputError

JobId = Annotated[str | None, typer.Argument(help="The job; without it the one on the bench.")]


def register(app: typer.Typer) -> None:
    """Add the commands."""

    @app.command()
    def jobs(
        job: Annotated[str | None, typer.Argument(help="One of them, with all that came of it.")] = None,
        status: Annotated[JobStatus | None, typer.Option(help="Only those.")] = None,
        limit: Annotated[int, typer.Option(min=1, max=1000, help="How many.")] = 20,
        url: Url = URL,
    ) -> None:
        """List jobs, the newest first.

        Example: bscd jobs --status interrupted
        """
        with client_at(url) as client:
            found = [client.job(job)] if job else client.jobs(status, limit)
        for one in found:
            typer.echo(job_line(one))
        for line in ending_lines(found[0]) if job else ():
            typer.echo(f"  {line}")

    @app.command()
    def pause(job: JobId = None, url: Url = URL) -> None:
        """Have a job stand still at its next safe point.

        Example: bscd pause
        """
        with client_at(url) as client:
            typer.echo(job_line(client.pause(_current(client, job))))

    @app.command()
    def resume(
        job: JobId = None,
        step: Annotated[int | None, typer.Option(min=0, help="Of a job that ended early: go on at this step.")] = None,
        follow: Annotated[bool, typer.Option("--follow", help="Stay until it ends.")] = False,
        url: Url = URL,
    ) -> None:
        """Go on with a job that is paused, that ended early, or that waits since a restart.

        Example: bscd resume 20261126-101500-a1b2 --follow
        """
        with client_at(url) as client:
            job_id = _current(client, job)
            ended = client.job(job_id).status.ended
            again = client.resume_from(job_id, step) if ended else client.resume(job_id)
            typer.echo(job_line(again))
            if follow:
                end(follow_job(client, job_id))

    @app.command()
    def stop(job: JobId = None, url: Url = URL) -> None:
        """End a job at its next safe point and keep what there is.

        Example: bscd stop
        """
        with client_at(url) as client:
            typer.echo(job_line(client.stop(_current(client, job))))

    @app.command()
    def abort(
        job: JobId = None,
        reason: Annotated[str, typer.Option(help="Why; kept in the journal.")] = "",
        url: Url = URL,
    ) -> None:
        """End a job at once: what moves is stopped where it is, the pressure is vented.

        Example: bscd abort --reason "wrong membrane"
        """
        with client_at(url) as client:
            typer.echo(job_line(client.abort(_current(client, job), reason)))

    @app.command()
    def confirm(
        job: Annotated[str, typer.Argument(help="The job that asks.")],
        prompt: Annotated[int, typer.Argument(help="The question's number.")],
        value: Annotated[float | None, typer.Argument(help="The answer, where it asks for a number.")] = None,
        url: Url = URL,
    ) -> None:
        """Answer the question of a job that waits.

        Example: bscd confirm 20261126-101500-a1b2 3
        """
        with client_at(url) as client:
            typer.echo(job_line(client.confirm(job, prompt, value)))


def _current(client: Client, job: str | None) -> str:
    if job is not None:
        return job
    now = client.status().job
    if now is None:
        raise InputError("no job is on the bench; name one of bscd jobs")
    return now.id
