"""Jobs: ask for one, follow it, pause, resume, stop, abort, go on, answer its question."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Body, Header, Path, Query, Response
from pydantic import BaseModel, ConfigDict, Field

from bscd.api.security import InControl, TheDaemon, Viewer
from bscd.daemon.documents import JobDocument, JobStatus, ValidationDocument
from bscd.daemon.recipes import RECIPES, AnyRecipe

router = APIRouter(tags=["jobs"])

JobId = Annotated[str, Path(pattern=r"^[0-9A-Za-z-]{1,60}$", description="of the job")]


class _Order(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Abort(_Order):
    """Why it is ended at once."""

    reason: str = Field(default="", max_length=500)


class ResumeFrom(_Order):
    """Where to go on: a scan's or a campaign's step; none: where it ended."""

    step: int | None = Field(default=None, ge=0, le=100_000)


class Confirm(_Order):
    """The answer to a question: its number, and a value in its unit where it asks for one."""

    prompt: int = Field(ge=0, le=2**31)
    value: float | None = None


@router.get("/recipes")
async def recipes(who: Viewer) -> dict[str, dict]:
    """The JSON schema of each recipe, by its name."""
    return {name: kind.model_json_schema() for name, kind in RECIPES.items()}


@router.post("/recipes:validate")
def validate(daemon: TheDaemon, who: Viewer, recipe: Annotated[AnyRecipe, Body()]) -> ValidationDocument:
    """What a recipe would take: limits over all positions, disk, duration; moves nothing."""
    return daemon.validate(recipe)


@router.get("/jobs")
def jobs(
    daemon: TheDaemon,
    who: Viewer,
    status: JobStatus | None = None,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    before: Annotated[str | None, Query(pattern=r"^[0-9A-Za-z-]{1,60}$", description="page on from this job")] = None,
) -> list[JobDocument]:
    """The newest first."""
    return daemon.jobs(status, limit, before)


@router.post("/jobs", status_code=202)
def submit(
    daemon: TheDaemon,
    who: InControl,
    response: Response,
    recipe: Annotated[AnyRecipe, Body()],
    idempotency_key: Annotated[str | None, Header(min_length=1, max_length=200)] = None,
) -> JobDocument:
    """Put a job in line; the same Idempotency-Key gives the same job for a day."""
    job = daemon.submit(recipe, who.name, idempotency_key)
    response.headers["Location"] = f"/api/v1/jobs/{job.id}"
    return job


@router.get("/jobs/{job_id}")
def job(daemon: TheDaemon, who: Viewer, job_id: JobId) -> JobDocument:
    """A job as it is now."""
    return daemon.job(job_id)


@router.post("/jobs/{job_id}/pause")
def pause(daemon: TheDaemon, who: InControl, job_id: JobId) -> JobDocument:
    """Stand still at the next safe point."""
    return daemon.pause_job(job_id, who.name)


@router.post("/jobs/{job_id}/resume")
def resume(daemon: TheDaemon, who: InControl, job_id: JobId) -> JobDocument:
    """Go on after a pause, or let one begin that has waited since before a restart."""
    return daemon.resume_job(job_id, who.name)


@router.post("/jobs/{job_id}/stop")
def stop(daemon: TheDaemon, who: InControl, job_id: JobId) -> JobDocument:
    """End at the next safe point and keep what there is."""
    return daemon.stop_job(job_id, who.name)


@router.post("/jobs/{job_id}/abort")
def abort(daemon: TheDaemon, who: InControl, job_id: JobId, order: Abort | None = None) -> JobDocument:
    """End at once: what moves is stopped where it is, the pressure is vented."""
    return daemon.abort_job(job_id, who.name, "" if order is None else order.reason)


@router.post("/jobs/{job_id}/resume-from", status_code=202)
def resume_from(daemon: TheDaemon, who: InControl, job_id: JobId, order: ResumeFrom | None = None) -> JobDocument:
    """Begin again a job that ended early, where it ended or at a step."""
    return daemon.resume_from(job_id, who.name, None if order is None else order.step)


@router.post("/jobs/{job_id}/confirm")
def confirm(daemon: TheDaemon, who: InControl, job_id: JobId, order: Confirm) -> JobDocument:
    """Answer the question of a job that waits."""
    return daemon.confirm(job_id, order.prompt, who.name, order.value)
