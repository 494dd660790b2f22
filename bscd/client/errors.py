"""The daemon's refusals as the errors that they were there."""

from __future__ import annotations

from typing import Any

import httpx

from bscd.daemon.errors import (
    EmergencyStoppedError,
    IllegalRequestError,
    InterlockError,
    NotInControlError,
    UnknownNameError,
)
from bscd.errors import BscdError, InputError


class ApiError(BscdError):
    """What the daemon answered, where it is none of its own errors; ``status``, ``code``, ``retryable``, ``hint``."""

    def __init__(self, detail: str, status: int, code: str, *, retryable: bool = False, hint: str = "") -> None:
        self.status, self.code, self.retryable, self.hint = status, code, retryable, hint
        super().__init__(detail)


class NoDaemonError(BscdError):
    """No daemon answers at that address."""


class NoPermissionError(ApiError):
    """The key is unknown, revoked, missing, or does not let its holder do this."""


class DeviceProblemError(ApiError):
    """A device of the rig does not do what it should; ``device`` names it."""

    device: str | None = None


class _ToldInterlockError(InterlockError):
    def __init__(self, detail: str, problems: list[str]) -> None:
        self.problems = tuple(problems)
        BscdError.__init__(self, detail)


class _ToldIllegalRequestError(IllegalRequestError):
    def __init__(self, detail: str, state: str, allowed: list[str]) -> None:
        self.state, self.allowed = state, tuple(allowed)
        BscdError.__init__(self, detail)


def raise_for(response: httpx.Response) -> None:
    """Raise what a response that is no success tells."""
    if response.is_success:
        return
    problem = _problem(response)
    detail, code = str(problem.get("detail", response.reason_phrase)), str(problem.get("code", ""))
    simple: dict[str, type[BscdError]] = {
        "unknown-name": UnknownNameError,
        "not-in-control": NotInControlError,
        "emergency-stopped": EmergencyStoppedError,
        "input": InputError,
    }
    if code in simple:
        raise simple[code](detail)
    if code == "illegal-request":
        raise _ToldIllegalRequestError(detail, str(problem.get("state", "")), list(problem.get("allowed") or []))
    if code == "interlock":
        raise _ToldInterlockError(detail, list(problem.get("problems") or []))
    more = {"retryable": bool(problem.get("retryable")), "hint": str(problem.get("hint", ""))}
    if response.status_code in (401, 403):
        raise NoPermissionError(detail, response.status_code, code, **more)
    if code in ("device", "rig-not-ready"):
        error = DeviceProblemError(detail, response.status_code, code, **more)
        error.device = problem.get("device")
        raise error
    raise ApiError(detail, response.status_code, code, **more)


def _problem(response: httpx.Response) -> dict[str, Any]:
    try:
        told = response.json()
    except ValueError:
        return {"detail": f"the daemon answered {response.status_code}: {response.text[:200]}"}
    return told if isinstance(told, dict) else {}
