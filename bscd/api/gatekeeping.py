"""What every request passes before a route sees it: host, size, rate, and the audit of what changes something."""

from __future__ import annotations

from urllib.parse import urlsplit

import structlog
from limits import RateLimitItemPerSecond
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bscd.api.problems import RefusedError, answer, problem_of
from bscd.api.refusals import Refusals
from bscd.api.security import is_loopback
from bscd.daemon.daemon import Daemon
from bscd.daemon.journal import JournalError

_LOG = structlog.get_logger(__name__)

#: Of ten seconds, so that a page that opens may ask for much at once.
_WINDOW_S = 10

_ESTOP = "/api/v1/estop"

#: Never refused for their rate.
_EXEMPT = (_ESTOP, "/health/")

#: Asked with POST, and change nothing.
_NO_CHANGE = ("/api/v1/recipes:validate", "/api/v1/tokens")


def _changes(scope: Scope) -> bool:
    return scope["method"] not in ("GET", "HEAD", "OPTIONS") and scope["path"].rstrip("/") not in _NO_CHANGE


def _stops(scope: Scope) -> bool:
    """Whether it is an e-stop, which neither its size nor its host's name keeps from stopping."""
    return scope["method"] == "POST" and scope["path"].rstrip("/") == _ESTOP


def _address(scope: Scope) -> str:
    client = scope.get("client")
    return client[0] if client else "unknown"


class RateLimit:
    """So many requests a second of one address, on average; answers 429 beyond."""

    def __init__(self, app: ASGIApp, requests_per_s: float, refusals: Refusals) -> None:
        self._app, self._refusals = app, refusals
        self._limit = RateLimitItemPerSecond(max(round(requests_per_s * _WINDOW_S), 1), _WINDOW_S)
        self._counts = MovingWindowRateLimiter(MemoryStorage())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass it on, or refuse it."""
        if scope["type"] == "http" and not scope["path"].startswith(_EXEMPT):
            address = _address(scope)
            if not self._counts.hit(self._limit, address):
                error = RefusedError(429, "too-many-requests", "too many requests; wait a second", retryable=True)
                if _changes(scope) and self._refusals.due(address):
                    method, path = scope["method"], scope["path"]
                    await run_in_threadpool(self._refusals.note, address, method, path, 429, str(error))
                await answer(problem_of(error), {"Retry-After": "1"})(scope, receive, send)
                return
        await self._app(scope, receive, send)


class OwnHost:
    """Requests by a name that this computer has for itself, so that no page of another host can pretend to be ours.

    An e-stop by another name passes where no page sent it: pages say their origin.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass it on, or refuse it."""
        if scope["type"] == "http":
            headers = Headers(scope=scope)
            host = headers.get("host", "")
            if not _is_own(host) and not (_stops(scope) and "origin" not in headers):
                told = f"Host {host[:80]!r}: is no name of this computer; ask 127.0.0.1, [::1] or localhost"
                scope.setdefault("state", {})["detail"] = told
                await answer(problem_of(RefusedError(400, "wrong-host", told)))(scope, receive, send)
                return
        await self._app(scope, receive, send)


def _is_own(host: str) -> bool:
    try:
        return is_loopback(urlsplit(f"//{host}").hostname or "")
    except ValueError:
        return False


class SizeLimit:
    """Bodies up to a size, whatever their header says; answers 413 beyond."""

    def __init__(self, app: ASGIApp, most_bytes: int) -> None:
        self._app, self._most = app, most_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Read the body before a route does; it is small. The e-stop's route reads its own."""
        if scope["type"] != "http" or scope["method"] in ("GET", "HEAD") or _stops(scope):
            await self._app(scope, receive, send)
            return
        body, more = b"", True
        while more:
            message = await receive()
            if message["type"] != "http.request":
                return
            body, more = body + message.get("body", b""), message.get("more_body", False)
            if len(body) > self._most:
                error = RefusedError(413, "too-large", f"a request may have {self._most} bytes; send less")
                scope.setdefault("state", {})["detail"] = str(error)
                await answer(problem_of(error), {"Connection": "close"})(scope, receive, send)
                return
        given = False

        async def again() -> Message:
            nonlocal given
            if given:
                return await receive()
            given = True
            return {"type": "http.request", "body": body, "more_body": False}

        await self._app(scope, again, send)


class Audit:
    """A line in the journal for each request that changes something or was refused, before it is answered."""

    def __init__(self, app: ASGIApp, daemon: Daemon, refusals: Refusals) -> None:
        self._app, self._daemon, self._refusals = app, daemon, refusals

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Note it as its answer begins, or as it fails."""
        if scope["type"] != "http" or not _changes(scope):
            await self._app(scope, receive, send)
            return
        state = scope.setdefault("state", {})
        request, begun = Request(scope), False

        async def noted(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                await run_in_threadpool(self._note, request, message["status"])
            await send(message)

        try:
            await self._app(scope, receive, noted)
        except Exception as error:
            if not begun:
                state["detail"] = problem_of(error).detail
                await run_in_threadpool(self._note, request, 500)
            raise

    def _note(self, request: Request, status: int) -> None:
        scope, state = request.scope, request.scope["state"]
        address, path, detail = _address(scope), scope["path"][:200], str(state.get("detail", ""))
        if status in (401, 403) and _stops(scope):  # it has no limit of rate
            if self._refusals.due(address):
                self._refusals.note(address, request.method, path, status, detail)
            return
        who = state.get("who") or f"unknown, {address}"
        try:
            self._daemon.journal.audit(who, request.method, path, str(status), detail)
        except JournalError as error:
            _LOG.error("the audit could not be written", who=who, path=path, error=str(error))
