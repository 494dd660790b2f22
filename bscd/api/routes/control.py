"""The e-stop, control of the rig, tokens for streams, and the audit."""

from __future__ import annotations

import asyncio
from contextlib import aclosing, suppress
from typing import Annotated

from fastapi import APIRouter, Query, Request
from pydantic import BaseModel, ConfigDict
from starlette.requests import ClientDisconnect

from bscd.api.problems import RefusedError
from bscd.api.security import Admin, Operator, Stopper, TheDaemon, Viewer, gate_of
from bscd.daemon.documents import AuditDocument, EStopDocument, LeaseDocument, StatusDocument
from bscd.daemon.estop_listener import REASON_S, reason_of

router = APIRouter(tags=["control"])


class EStopOrder(BaseModel):
    """Why, in 200 characters; what can not be read, or is more, is left out: no body keeps the rig from stopping."""

    reason: str = ""


class LeaseOrder(BaseModel):
    """``force`` takes control from whoever has it; for admins."""

    model_config = ConfigDict(extra="forbid")

    force: bool = False


class Token(BaseModel):
    """Opens one stream, once, within its life."""

    token: str
    lifetime_s: float


_ESTOP_BODY = {"content": {"application/json": {"schema": {"$ref": "#/components/schemas/EStopOrder"}}}}


@router.post("/estop/", include_in_schema=False)
@router.post("/estop", openapi_extra={"requestBody": _ESTOP_BODY})
async def estop(request: Request, daemon: TheDaemon, who: Stopper) -> EStopDocument:
    """Stop every axis and vent, now; any role may. Latched until an operator resets it."""
    reason = await _reason(request, daemon.settings.request_limit_bytes)
    loop = asyncio.get_running_loop()
    return await loop.run_in_executor(request.app.state.estop_threads, daemon.estop.trigger, who, reason)


async def _reason(request: Request, most_bytes: int) -> str:
    body = b""
    with suppress(TimeoutError, ClientDisconnect):
        async with asyncio.timeout(REASON_S), aclosing(request.stream()) as pieces:
            async for piece in pieces:
                body += piece
                if len(body) > most_bytes:
                    return ""
    return reason_of(body)


@router.get("/estop")
async def estop_state(daemon: TheDaemon, who: Viewer) -> EStopDocument:
    """Whether it is latched."""
    return daemon.estop.document()


@router.post("/estop/reset")
def reset(daemon: TheDaemon, who: Operator) -> StatusDocument:
    """Let things move again; nothing does by itself."""
    daemon.reset_estop(who.name)
    return daemon.status()


@router.get("/lease")
async def lease(daemon: TheDaemon, who: Viewer) -> LeaseDocument | None:
    """Who is in control of the rig."""
    return daemon.lease.document()


@router.post("/lease")
async def take(daemon: TheDaemon, who: Operator, order: LeaseOrder | None = None) -> LeaseDocument:
    """Take control, or renew it."""
    force = order is not None and order.force
    if force and not who.may("admin"):
        raise RefusedError(403, "forbidden", f"{who.name} is {who.role}; taking control by force needs admin")
    return daemon.lease.take(who.name, force=force)


@router.delete("/lease", status_code=204)
async def release(daemon: TheDaemon, who: Operator) -> None:
    """Give control back."""
    daemon.lease.release(who.name)


@router.post("/tokens")
async def token(request: Request, who: Viewer) -> Token:
    """A token for an address where a header can not be sent: ``?token=`` of events and camera streams."""
    tokens = gate_of(request).tokens
    return Token(token=tokens.issue(who), lifetime_s=tokens.lifetime_s)


@router.get("/audit")
def audit(daemon: TheDaemon, who: Admin, limit: Annotated[int, Query(ge=1, le=1000)] = 100) -> list[AuditDocument]:
    """Who asked for what, the newest first."""
    return daemon.journal.audits(limit)
