"""The rig at a glance, its devices, and whether the daemon is well."""

from __future__ import annotations

from fastapi import APIRouter, Response
from pydantic import BaseModel

from bscd.api.security import InControl, TheDaemon, Viewer
from bscd.daemon.documents import DeviceDocument, StatusDocument

router = APIRouter(tags=["rig"])
health = APIRouter(tags=["health"], prefix="/health")


class Health(BaseModel):
    """Whether it is well, and what is wrong."""

    ok: bool
    detail: str = ""


@router.get("/status")
async def status(daemon: TheDaemon, who: Viewer) -> StatusDocument:
    """Everything at a glance; ``revision`` grows with each change."""
    return daemon.status()


@router.get("/devices")
async def devices(daemon: TheDaemon, who: Viewer) -> dict[str, DeviceDocument]:
    """The devices as they were last seen, by their names."""
    return daemon.devices()


@router.post("/connect")
def connect(daemon: TheDaemon, who: InControl) -> StatusDocument:
    """Connect every device and vent; nothing moves."""
    daemon.connect(who.name)
    return daemon.status()


@router.post("/disconnect")
def disconnect(daemon: TheDaemon, who: InControl) -> StatusDocument:
    """Vent and release every device."""
    daemon.disconnect(who.name)
    return daemon.status()


@health.get("/live", responses={503: {"model": Health, "description": "it is not"}})
async def live(daemon: TheDaemon, response: Response) -> Health:
    """Whether the daemon works; a rig at fault does not make it unwell."""
    well, why = daemon.live()
    response.status_code = 200 if well else 503
    return Health(ok=well, detail=why)


@health.get("/ready", responses={503: {"model": Health, "description": "it is not"}})
async def ready(daemon: TheDaemon, response: Response) -> Health:
    """Whether the rig can take a job."""
    well, why = daemon.ready()
    response.status_code = 200 if well else 503
    return Health(ok=well, detail=why)
