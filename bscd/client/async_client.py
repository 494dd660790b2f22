"""Talk to a running daemon from asyncio."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from types import TracebackType
from typing import Any, Self, TypeVar

import httpx
from httpx_sse import aconnect_sse
from pydantic import BaseModel

from bscd.client import calls
from bscd.client.calls import Call, Camera, Kind
from bscd.client.connection import DEFAULT_URL, Connection
from bscd.client.errors import NoDaemonError, raise_for
from bscd.client.following import AGAIN_S, SILENCE_S, JobFollower
from bscd.daemon.documents import (
    DeviceDocument,
    EStopDocument,
    FileDocument,
    JobDocument,
    JobStatus,
    StatusDocument,
    ValidationDocument,
)
from bscd.errors import BscdError

Answer = TypeVar("Answer")


class AsyncClient:
    """As `bscd.Client`, for asyncio; an asynchronous context manager."""

    def __init__(
        self,
        url: str = DEFAULT_URL,
        *,
        key: str | None = None,
        operator: str | None = None,
        estop_url: str | None = None,
        timeout_s: float = 30.0,
    ) -> None:
        self._to = Connection(url, key, operator, estop_url, timeout_s)
        self._http = httpx.AsyncClient(base_url=self._to.url, headers=self._to.headers, timeout=timeout_s)

    async def status(self) -> StatusDocument:
        """Everything at a glance."""
        return await self._do(calls.status())

    async def devices(self) -> dict[str, DeviceDocument]:
        """The devices as they were last seen."""
        return await self._do(calls.devices())

    async def connect(self) -> StatusDocument:
        """Connect the rig; nothing moves."""
        return await self._do(calls.rig("connect"))

    async def validate(self, recipe: BaseModel | dict[str, Any]) -> ValidationDocument:
        """What a recipe would take."""
        return await self._do(calls.validate(recipe))

    async def submit(self, recipe: BaseModel | dict[str, Any], *, idempotency_key: str | None = None) -> JobDocument:
        """Put a job in line."""
        return await self._do(calls.submit(recipe, idempotency_key))

    async def jobs(self, status: JobStatus | None = None, limit: int = 100) -> list[JobDocument]:
        """The newest first."""
        return await self._do(calls.jobs(status, limit))

    async def job(self, job_id: str) -> JobDocument:
        """A job as it is now."""
        return await self._do(calls.job(job_id))

    async def act(self, job_id: str, what: str, **order: Any) -> JobDocument:
        """Pause, resume, stop, abort (``reason``), resume-from (``step``) or confirm (``prompt``, ``value``)."""
        return await self._do(calls.act(job_id, what, order or None))

    async def estop(self, reason: str = "") -> EStopDocument:
        """Stop everything."""
        return await self._do(calls.estop(reason))

    async def reset_estop(self) -> StatusDocument:
        """Let things move again."""
        return await self._do(calls.rig("estop/reset"))

    async def files(self, kind: Kind) -> list[FileDocument]:
        """Runs, calibrations, results or reports."""
        return await self._do(calls.files(kind))

    async def snapshot(self, camera: Camera = "primary", width_px: int = 1280) -> bytes:
        """A camera's newest frame, JPEG."""
        return await self._do(calls.snapshot(camera, width_px))

    async def follow(self, job_id: str, *, patience_s: float = 60.0) -> AsyncIterator[JobDocument]:
        """The job each time something of it changes, up to its end."""
        follower, silent_since_s = JobFollower(job_id), time.monotonic()
        while True:
            try:
                async with aconnect_sse(
                    self._http, "GET", f"{calls.API}/events", headers=follower.headers, timeout=SILENCE_S
                ) as source:
                    if not source.response.is_success:
                        await source.response.aread()
                        raise_for(source.response)
                    if job := follower.news(await self.job(job_id)):
                        yield job
                        if job.status.ended:
                            return
                    async for event in source.aiter_sse():
                        silent_since_s = time.monotonic()
                        if job := follower.taken(event):
                            yield job
                            if job.status.ended:
                                return
            except (httpx.TransportError, NoDaemonError) as error:
                if time.monotonic() - silent_since_s > patience_s:
                    raise NoDaemonError(f"{self._to.url}: has not answered for {patience_s:g} s") from error
            await asyncio.sleep(AGAIN_S)

    async def wait(self, job_id: str) -> JobDocument:
        """The job at its end. Raises `BscdError` with its reason unless it was done."""
        job = None
        async for job in self.follow(job_id):  # noqa: B007 - the last one is wanted
            pass
        if job is None or job.status is not JobStatus.DONE:
            told = "nothing is known of it" if job is None else f"{job.status.value}: {job.reason}"
            raise BscdError(f"job {job_id}: {told}")
        return job

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def _do(self, call: Call[Answer]) -> Answer:
        try:
            response = await self._http.request(
                call.method, call.path, json=call.body, params=call.query, headers=call.headers
            )
        except httpx.TransportError as error:
            raise self._to.no_daemon(error) from error
        raise_for(response)
        return call.read(response.content)

    async def __aenter__(self) -> Self:
        """The client."""
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        await self.close()
