"""What the daemon tells: jobs, status, devices, as frozen models that the API, the client and the journal share."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from bscd.daemon.recipes import AnyRecipe


class Document(BaseModel):
    """A document: frozen; unknown fields are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class RigState(StrEnum):
    """What the rig is doing; the allowed transitions are in `bscd.daemon.states`."""

    OFFLINE = "offline"
    CONNECTING = "connecting"
    IDLE = "idle"
    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"
    STOPPING = "stopping"
    FAULT = "fault"
    ESTOPPED = "e-stopped"


class JobStatus(StrEnum):
    """Where a job is; those from "done" on are its end."""

    QUEUED = "queued"
    RUNNING = "running"
    WAITING = "waiting"
    """For the operator: see ``prompt``."""
    PAUSING = "pausing"
    PAUSED = "paused"
    STOPPING = "stopping"
    DONE = "done"
    STOPPED = "stopped"
    """Ended early as asked; what it has is kept."""
    ABORTED = "aborted"
    """Ended at once, with a reason."""
    FAILED = "failed"
    INTERRUPTED = "interrupted"
    """The daemon ended under it."""

    @property
    def ended(self) -> bool:
        """Whether nothing more happens to it, unless it is resumed from where it ended."""
        return self in (self.DONE, self.STOPPED, self.ABORTED, self.FAILED, self.INTERRUPTED)


class JobProgress(Document):
    """``done`` of ``total`` ``unit``; ``left_s`` is the estimated time left, s, None while not known."""

    done: int = Field(ge=0)
    total: int = Field(ge=0)
    unit: str
    doing: str
    left_s: float | None = None


class PromptDocument(Document):
    """What the operator is asked; `limits` and `unit` where the answer is a number, else it is a confirmation."""

    id: int
    text: str
    device: str = ""
    unit: str = ""
    limits: tuple[float, float] | None = None
    proposal: float | None = None


class JobDocument(Document):
    """A job: what it does, how far it is, what came of it. Times are UTC.

    ``place`` is "bench" for what needs the rig, "desk" for offline work. ``outputs`` are the names of runs,
    calibrations, results and reports that it made, by what they are; ``figures`` its results, units in their names.
    ``next_step`` is where ``resume-from`` would go on, None where it can not.
    """

    id: str
    recipe: AnyRecipe
    place: Literal["bench", "desk"]
    status: JobStatus
    operator: str
    created_at: datetime
    started_at: datetime | None = None
    ended_at: datetime | None = None
    progress: JobProgress | None = None
    prompt: PromptDocument | None = None
    reason: str = ""
    next_step: int | None = None
    outputs: dict[str, str] = Field(default_factory=dict)
    figures: dict[str, Any] = Field(default_factory=dict)
    warnings: tuple[str, ...] = ()


class DeviceDocument(Document):
    """A device as it was last seen; ``reading`` and ``unit`` where it has one, ``problem`` where it is not well."""

    name: str
    kind: Literal["camera", "axis", "pressure"]
    driver: str
    connected: bool
    identity: str = ""
    reading: float | None = None
    unit: str = ""
    homed: bool | None = None
    moving: bool | None = None
    details: dict[str, Any] = Field(default_factory=dict)
    problem: str = ""


class EStopDocument(Document):
    """Whether the e-stop is latched, by whom, since when, and how long its last stop command took (ms)."""

    latched: bool
    by: str = ""
    at: datetime | None = None
    took_ms: float | None = None
    failures: tuple[str, ...] = ()


class LeaseDocument(Document):
    """Who is in control of the rig, and until when unless renewed."""

    holder: str
    until: datetime


class LiveDocument(Document):
    """The last live map of the inflation that runs: its frame, how many points it has, its largest w and latency.

    ``behind`` is how many frames have come since.
    """

    frame: int
    points: int
    valid: int
    w_max_mm: float | None
    latency_s: float
    behind: int


class StatusDocument(Document):
    """Everything at a glance; ``revision`` grows with each change."""

    revision: int
    time: datetime
    version: str
    rig: str
    state: RigState
    allowed: tuple[str, ...]
    reason: str = ""
    job: JobDocument | None = None
    queue: tuple[str, ...] = ()
    desk: tuple[str, ...] = ()
    devices: dict[str, DeviceDocument] = Field(default_factory=dict)
    estop: EStopDocument
    lease: LeaseDocument | None = None
    live: LiveDocument | None = None
    disk_free_bytes: int
    pressure_kpa: float | None = None


class ValidationDocument(Document):
    """What a recipe would take, computed before anything moves; ``problems`` keep it from starting."""

    ok: bool
    problems: tuple[str, ...] = ()
    frames: int = 0
    duration_s: float | None = None
    disk_bytes: int = 0
    limits: dict[str, dict[str, float]] = Field(default_factory=dict)
    """For each axis: least and greatest reading it is sent to, and its limits."""


class FileDocument(Document):
    """A run, calibration, result or report in the data folder; ``about`` is what its header tells."""

    name: str
    kind: Literal["run", "calibration", "result", "report"]
    bytes: int
    modified_at: datetime
    about: dict[str, Any] = Field(default_factory=dict)
    problem: str = ""


class AuditDocument(Document):
    """A request that changed something, or was refused for who asked."""

    id: int
    time: datetime
    who: str
    action: str
    target: str
    outcome: str
    detail: str = ""
