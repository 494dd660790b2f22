"""Talk to a running daemon from asyncio."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import httpx
from httpx_sse import aconnect_sse
from pydantic import BaseModel

from bscd.client import calls
from bscd.client.calls import Call, Camera, Kind
from bscd.client.connection import DEFAULT_URL, ESTOP_API_S, ESTOP_OWN_S, Connection
from bscd.client.downloading import PIECE_BYTES, Download
from bscd.client.errors import NoDaemonError, NoPermissionError, raise_for
from bscd.client.following import AGAIN_S, SILENCE_S, JobFollower
from bscd.daemon.documents import (
    DeviceDocument,
    EStopDocument,
    FileDocument,
    JobDocument,
    JobStatus,
    LeaseDocument,
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

    async def disconnect(self) -> StatusDocument:
        """Vent and release every device."""
        return await self._do(calls.rig("disconnect"))

    async def validate(self, recipe: BaseModel | dict[str, Any]) -> ValidationDocument:
        """What a recipe would take, and what keeps it from starting."""
        return await self._do(calls.validate(recipe))

    async def submit(self, recipe: BaseModel | dict[str, Any], *, idempotency_key: str | None = None) -> JobDocument:
        """Put a job in line; the same key gives the same job."""
        return await self._do(calls.submit(recipe, idempotency_key))

    async def jobs(
        self, status: JobStatus | None = None, limit: int = 100, before: str | None = None
    ) -> list[JobDocument]:
        """The newest first."""
        return await self._do(calls.jobs(status, limit, before))

    async def job(self, job_id: str) -> JobDocument:
        """A job as it is now."""
        return await self._do(calls.job(job_id))

    async def pause(self, job_id: str) -> JobDocument:
        """Stand still at the next safe point."""
        return await self._do(calls.act(job_id, "pause"))

    async def resume(self, job_id: str) -> JobDocument:
        """Go on after a pause."""
        return await self._do(calls.act(job_id, "resume"))

    async def stop(self, job_id: str) -> JobDocument:
        """End at the next safe point and keep what there is."""
        return await self._do(calls.act(job_id, "stop"))

    async def abort(self, job_id: str, reason: str = "") -> JobDocument:
        """End at once."""
        return await self._do(calls.act(job_id, "abort", {"reason": reason}))

    async def resume_from(self, job_id: str, step: int | None = None) -> JobDocument:
        """Begin again a job that ended early, where it ended or at a step."""
        return await self._do(calls.act(job_id, "resume-from", {"step": step}))

    async def confirm(self, job_id: str, prompt: int, value: float | None = None) -> JobDocument:
        """Answer the question of a job that waits."""
        return await self._do(calls.act(job_id, "confirm", {"prompt": prompt, "value": value}))

    async def estop(self, reason: str = "") -> EStopDocument:
        """Stop everything; by the e-stop's own listener where the API does not do it soon.

        Raises `NoPermissionError` without a key where one is needed, `NoDaemonError` when neither does it.
        """
        try:
            return await self._do(calls.estop(reason), timeout_s=ESTOP_API_S)
        except NoPermissionError:
            raise
        except Exception as error:  # whatever it is, the other way may be open
            api = error
        try:
            return await self._do(calls.estop(reason, self._to.estop_url), timeout_s=ESTOP_OWN_S)
        except NoPermissionError:
            raise
        except Exception as error:
            raise self._to.not_stopped(api, error) from error

    async def reset_estop(self) -> StatusDocument:
        """Let things move again; nothing does by itself."""
        return await self._do(calls.rig("estop/reset"))

    async def follow(self, job_id: str, *, patience_s: float = 60.0) -> AsyncIterator[JobDocument]:
        """The job each time something of it changes, up to its end; over broken lines for ``patience_s``."""
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

    async def files(self, kind: Kind) -> list[FileDocument]:
        """Runs, calibrations, results or reports, the newest first."""
        return await self._do(calls.files(kind))

    async def download(self, kind: Kind, name: str, to: Path | str, *, file: str = "report.html") -> Path:
        """Fetch a file into the new file ``to``; one that was cut off goes on where it ended (``to``.part).

        Raises `BscdError` when ``to`` exists.
        """
        download = Download(to)
        try:
            await self._fetch(calls.file_path(kind, name, file), download)
        except httpx.TransportError as error:
            raise download.cut_off(error) from error
        return download.ended()

    async def snapshot(self, camera: Camera = "primary", width_px: int = 1280) -> bytes:
        """A camera's newest frame, JPEG."""
        return await self._do(calls.snapshot(camera, width_px))

    @asynccontextmanager
    async def control(self, *, force: bool = False) -> AsyncIterator[LeaseDocument]:
        """Be in control of the rig; each change renews it, and it is given back at the end."""
        lease = await self._do(calls.take_lease(force=force))
        try:
            yield lease
        except BaseException:
            with suppress(BscdError):  # what ended the block is told, not this
                await self._do(calls.release_lease())
            raise
        await self._do(calls.release_lease())

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def _do(self, call: Call[Answer], *, timeout_s: float | None = None) -> Answer:
        try:
            response = await self._http.request(**call.asked(self._to.timeout_s if timeout_s is None else timeout_s))
        except httpx.TransportError as error:
            raise self._to.no_daemon(error) from error
        return call.answered(response)

    async def _fetch(self, path: str, download: Download) -> None:
        async with self._http.stream("GET", path, headers=download.headers) as response:
            if download.is_whole(response):
                return
            if not response.is_success:
                await response.aread()
                raise_for(response)
            with download.opened(response) as file:
                async for piece in response.aiter_bytes(PIECE_BYTES):
                    await asyncio.to_thread(file.write, piece)

    async def __aenter__(self) -> Self:
        """The client."""
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        await self.close()
