"""Every call of the API once, whoever sends it: what is asked and how the answer is read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, TypeVar
from urllib.parse import quote

import httpx
from pydantic import BaseModel, TypeAdapter, ValidationError

from bscd.client.errors import ApiError, raise_for
from bscd.daemon.documents import (
    AuditDocument,
    DeviceDocument,
    EStopDocument,
    FileDocument,
    JobDocument,
    JobStatus,
    LeaseDocument,
    StatusDocument,
    ValidationDocument,
)

API = "/api/v1"
Kind = Literal["run", "calibration", "result", "report"]
Action = Literal["pause", "resume", "stop", "abort", "resume-from", "confirm"]
Camera = Literal["primary", "auxiliary"]

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Call(Generic[Answer]):
    """A request, and how its answer is read."""

    method: str
    path: str
    read: Callable[[bytes], Answer]
    body: Any = None
    query: dict[str, Any] = field(default_factory=dict)
    headers: dict[str, str] = field(default_factory=dict)

    def asked(self, timeout_s: float) -> dict[str, Any]:
        """What httpx sends."""
        return {
            "method": self.method,
            "url": self.path,
            "json": self.body,
            "params": self.query,
            "headers": self.headers,
            "timeout": timeout_s,
        }

    def answered(self, response: httpx.Response) -> Answer:
        """The answer. Raises what a refusal tells, `ApiError` for an answer that is none of this version's."""
        raise_for(response)
        try:
            return self.read(response.content)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(str(part) for part in first["loc"])
            raise ApiError(
                f"{self.path}: the answer is none that is known ({where}: {first['msg']}); "
                f"is the daemon of this version, and is it one?",
                response.status_code,
                "unknown-answer",
            ) from error


def status() -> Call[StatusDocument]:
    """Everything at a glance."""
    return Call("GET", f"{API}/status", StatusDocument.model_validate_json)


def devices() -> Call[dict[str, DeviceDocument]]:
    """The devices as they were last seen."""
    return Call("GET", f"{API}/devices", TypeAdapter(dict[str, DeviceDocument]).validate_json)


def rig(what: Literal["connect", "disconnect", "estop/reset"]) -> Call[StatusDocument]:
    """Connect or release the devices, or reset the e-stop."""
    return Call("POST", f"{API}/{what}", StatusDocument.model_validate_json)


def validate(recipe: BaseModel | dict[str, Any]) -> Call[ValidationDocument]:
    """What a recipe would take."""
    return Call("POST", f"{API}/recipes:validate", ValidationDocument.model_validate_json, _plain(recipe))


def submit(recipe: BaseModel | dict[str, Any], idempotency_key: str | None = None) -> Call[JobDocument]:
    """Put a job in line."""
    headers = {} if idempotency_key is None else {"Idempotency-Key": idempotency_key}
    return Call("POST", f"{API}/jobs", JobDocument.model_validate_json, _plain(recipe), headers=headers)


def jobs(state: JobStatus | None = None, limit: int = 100, before: str | None = None) -> Call[list[JobDocument]]:
    """The newest first."""
    query = {"status": None if state is None else state.value, "limit": limit, "before": before}
    given = {name: value for name, value in query.items() if value is not None}
    return Call("GET", f"{API}/jobs", TypeAdapter(list[JobDocument]).validate_json, query=given)


def job(job_id: str) -> Call[JobDocument]:
    """A job as it is now."""
    return Call("GET", f"{API}/jobs/{_part(job_id)}", JobDocument.model_validate_json)


def act(job_id: str, what: Action, body: dict[str, Any] | None = None) -> Call[JobDocument]:
    """Have a job do something."""
    return Call("POST", f"{API}/jobs/{_part(job_id)}/{what}", JobDocument.model_validate_json, body)


def estop(reason: str = "", at: str = f"{API}/estop") -> Call[EStopDocument]:
    """Stop everything; ``at`` may be the e-stop's own address."""
    told = reason.encode(errors="replace").decode()  # arguments of a command may hold what is no text
    return Call("POST", at, EStopDocument.model_validate_json, {"reason": told})


def take_lease(*, force: bool = False) -> Call[LeaseDocument]:
    """Take control, or renew it."""
    return Call("POST", f"{API}/lease", LeaseDocument.model_validate_json, {"force": force})


def release_lease() -> Call[None]:
    """Give control back."""
    return Call("DELETE", f"{API}/lease", lambda _: None)


def files(kind: Kind) -> Call[list[FileDocument]]:
    """All of a kind, the newest first."""
    return Call("GET", f"{API}/{kind}s", TypeAdapter(list[FileDocument]).validate_json)


def file_path(kind: Kind, name: str, file: str = "") -> str:
    """Where a file is downloaded from; a report's ``file`` is its page or a picture."""
    return f"{API}/{kind}s/{_part(name)}/{_part(file) if kind == 'report' else 'file'}"


def about(kind: Kind, name: str) -> Call[FileDocument]:
    """What a file's header tells."""
    return Call("GET", f"{API}/{kind}s/{_part(name)}", FileDocument.model_validate_json)


def snapshot(camera: Camera, width_px: int = 1280) -> Call[bytes]:
    """The newest frame as a JPEG."""
    return Call("GET", f"{API}/camera/{camera}/snapshot.jpg", lambda content: content, query={"width": width_px})


def audit(limit: int = 100) -> Call[list[AuditDocument]]:
    """Who asked for what, the newest first."""
    return Call("GET", f"{API}/audit", TypeAdapter(list[AuditDocument]).validate_json, query={"limit": limit})


def _plain(recipe: BaseModel | dict[str, Any]) -> Any:
    return recipe.model_dump(mode="json") if isinstance(recipe, BaseModel) else recipe


def _part(text: str) -> str:
    return quote(text, safe="")
