"""The e-stop, control of the rig, tokens for streams, and the audit."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Query, Request
from pydantic import BaseModel, ConfigDict, Field

from bscd.api.problems import RefusedError
from bscd.api.security import Admin, Operator, TheDaemon, Viewer, gate_of
from bscd.daemon.documents import AuditDocument, EStopDocument, LeaseDocument, StatusDocument

router = APIRouter(tags=["control"])


class _Order(BaseModel):
    model_config = ConfigDict(extra="forbid")


class EStopOrder(_Order):
    """Why; it may be left out."""

    reason: str = Field(default="", max_length=200)


class LeaseOrder(_Order):
    """``force`` takes control from whoever has it; for admins."""

    force: bool = False


class Token(BaseModel):
    """Opens one stream, once, within its life."""

    token: str
    lifetime_s: float


@router.post("/estop")
async def estop(request: Request, daemon: TheDaemon, who: Viewer, order: EStopOrder | None = None) -> EStopDocument:
    """Stop every axis and vent, now; any role may. Latched until an operator resets it."""
    reason = "" if order is None else order.reason
    loop = asyncio.get_running_loop()
    return await loop.run_in_executor(request.app.state.estop_threads, daemon.estop.trigger, who.name, reason)


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
