"""What went wrong, as RFC 9457 problem+json: a code for programs, a sentence for people, and what to do."""

from __future__ import annotations

from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException

from bscd.daemon.errors import (
    EmergencyStoppedError,
    IllegalRequestError,
    InterlockError,
    NotInControlError,
    UnknownNameError,
)
from bscd.daemon.journal import JournalError
from bscd.errors import BscdError, InputError
from bscd.procedures import RigNotReadyError
from drivers.errors import DeviceError, DeviceTimeoutError, NotConnectedError

_LOG = structlog.get_logger(__name__)

MEDIA_TYPE = "application/problem+json"


class Problem(BaseModel):
    """RFC 9457, with ``code`` for programs; ``state`` and ``allowed`` where the state was the reason."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str
    code: str
    device: str | None = None
    retryable: bool = False
    hint: str = ""
    state: str | None = None
    allowed: list[str] | None = None
    problems: list[str] = Field(default_factory=list)


class RefusedError(BscdError):
    """The API itself refuses: who asked, or how."""

    def __init__(
        self, status: int, code: str, detail: str, *, retryable: bool = False, headers: dict[str, str] | None = None
    ) -> None:
        self.status, self.code, self.retryable, self.headers = status, code, retryable, headers or {}
        super().__init__(detail)


_TITLES = {
    400: "Malformed request",
    401: "Key needed",
    403: "Not allowed",
    404: "Not found",
    405: "Method not allowed",
    409: "Not possible now",
    413: "Too large",
    416: "Range not satisfiable",
    422: "Refused",
    423: "Somebody else is in control",
    429: "Too many requests",
    500: "A mistake in the program",
    503: "A device does not do what it should",
    507: "The journal can not be kept",
}

#: Errors of the daemon by their kind, the narrower first.
_KINDS: tuple[tuple[type[Exception], int, str], ...] = (
    (IllegalRequestError, 409, "illegal-request"),
    (EmergencyStoppedError, 409, "emergency-stopped"),
    (InterlockError, 422, "interlock"),
    (UnknownNameError, 404, "unknown-name"),
    (NotInControlError, 423, "not-in-control"),
    (RigNotReadyError, 503, "rig-not-ready"),
    (JournalError, 507, "journal"),
    (InputError, 422, "input"),
    (BscdError, 422, "refused"),
)


def problem_of(error: Exception) -> Problem:
    """The problem that an error is told as."""
    if isinstance(error, RefusedError):
        return _problem(error.status, error.code, str(error), retryable=error.retryable)
    if isinstance(error, DeviceError):
        return _problem(
            503,
            "device",
            str(error),
            device=error.device,
            hint=error.hint,
            retryable=isinstance(error, NotConnectedError | DeviceTimeoutError),
        )
    for kind, status, code in _KINDS:
        if isinstance(error, kind):
            more: dict[str, Any] = {"retryable": status in (503, 507)}
            if isinstance(error, IllegalRequestError):
                more |= {"state": error.state, "allowed": list(error.allowed)}
            if isinstance(error, InterlockError):
                more["problems"] = list(error.problems)
            return _problem(status, code, str(error), **more)
    return _problem(500, "internal", f"{type(error).__name__}; see the log")


def answer(problem: Problem, headers: dict[str, str] | None = None) -> JSONResponse:
    """The response."""
    content = problem.model_dump(mode="json", exclude_none=True)
    return JSONResponse(content, problem.status, headers=headers, media_type=MEDIA_TYPE)


def add_handlers(app: FastAPI) -> None:
    """Tell every error so."""

    async def known(request: Request, error: Exception) -> JSONResponse:
        problem = problem_of(error)
        request.state.detail = problem.detail
        return answer(problem, getattr(error, "headers", None))

    async def invalid(request: Request, error: Exception) -> JSONResponse:
        problem = _invalid(error) if isinstance(error, RequestValidationError) else problem_of(error)
        request.state.detail = problem.detail
        return answer(problem)

    async def http(request: Request, error: Exception) -> JSONResponse:
        status = getattr(error, "status_code", 500)
        code = {400: "malformed", 404: "not-found", 405: "method-not-allowed"}.get(status, "http")
        problem = _problem(status, code, f"{request.method} {request.url.path}: {getattr(error, 'detail', '')}")
        request.state.detail = problem.detail
        return answer(problem, getattr(error, "headers", None))

    async def mistake(request: Request, error: Exception) -> JSONResponse:
        _LOG.error("a mistake in the program", path=request.url.path, exc_info=error)
        return answer(problem_of(error))

    app.add_exception_handler(BscdError, known)
    app.add_exception_handler(DeviceError, known)
    app.add_exception_handler(RequestValidationError, invalid)
    app.add_exception_handler(HTTPException, http)
    app.add_exception_handler(Exception, mistake)


def _problem(status: int, code: str, detail: str, **more: Any) -> Problem:
    return Problem(title=_TITLES.get(status, "Refused"), status=status, detail=detail, code=code, **more)


def _invalid(error: RequestValidationError) -> Problem:
    problems = []
    for one in error.errors():
        if one["type"] == "json_invalid":
            reason = one.get("ctx", {}).get("error", "")
            return _problem(400, "malformed", f"the body is no JSON: {reason} at character {one['loc'][-1]}")
        place = ".".join(str(part) for part in one["loc"] if part != "body")
        message = str(one["msg"]).removeprefix("Value error, ")
        problems.append(f"{place}: {message}" if place else message)
    return _problem(422, "input", "; ".join(problems), problems=problems)


#: What any route may answer, for OpenAPI.
PROBLEMS: dict[int | str, dict[str, Any]] = {
    status: {
        "description": _TITLES[status],
        "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
    }
    for status in (400, 401, 403, 404, 405, 409, 413, 422, 423, 429, 503, 507)
}
