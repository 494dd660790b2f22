"""What every request passes before a route sees it: its size, its rate, and the audit of what changes something."""

from __future__ import annotations

import structlog
from limits import RateLimitItemPerSecond
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bscd.api.problems import RefusedError, answer, problem_of
from bscd.daemon.daemon import Daemon
from bscd.daemon.journal import JournalError

_LOG = structlog.get_logger(__name__)

#: Of ten seconds, so that a page that opens may ask for much at once.
_WINDOW_S = 10

#: Never refused for their rate.
_EXEMPT = ("/api/v1/estop", "/health/")

#: Asked with POST, and change nothing.
_NO_CHANGE = ("/api/v1/recipes:validate", "/api/v1/tokens")


class RateLimit:
    """So many requests a second of one address, on average; answers 429 beyond."""

    def __init__(self, app: ASGIApp, requests_per_s: float) -> None:
        self._app = app
        self._limit = RateLimitItemPerSecond(max(round(requests_per_s * _WINDOW_S), 1), _WINDOW_S)
        self._counts = MovingWindowRateLimiter(MemoryStorage())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass it on, or refuse it."""
        if scope["type"] == "http" and not scope["path"].startswith(_EXEMPT):
            client = scope.get("client")
            if not self._counts.hit(self._limit, client[0] if client else "unknown"):
                error = RefusedError(429, "too-many-requests", "too many requests; wait a second", retryable=True)
                await answer(problem_of(error), {"Retry-After": "1"})(scope, receive, send)
                return
        await self._app(scope, receive, send)


class SizeLimit:
    """Bodies up to a size, whatever their header says; answers 413 beyond."""

    def __init__(self, app: ASGIApp, most_bytes: int) -> None:
        self._app, self._most = app, most_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Read the body before a route does; it is small."""
        if scope["type"] != "http" or scope["method"] in ("GET", "HEAD"):
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

    def __init__(self, app: ASGIApp, daemon: Daemon) -> None:
        self._app, self._daemon = app, daemon

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Note it as its answer begins."""
        if (
            scope["type"] != "http"
            or scope["method"] in ("GET", "HEAD", "OPTIONS")
            or scope["path"].rstrip("/") in _NO_CHANGE
        ):
            await self._app(scope, receive, send)
            return
        scope.setdefault("state", {})
        scope.setdefault("state", {})
        request = Request(scope)

        async def noted(message: Message) -> None:
            if message["type"] == "http.response.start":
                await run_in_threadpool(self._note, request, message["status"])
            await send(message)

        await self._app(scope, receive, noted)

    def _note(self, request: Request, status: int) -> None:
        state = request.scope.get("state", {})
        client = request.client.host if request.client else ""
        who = state.get("who") or f"unknown, {client}"
        try:
            self._daemon.journal.audit(
                who, request.method, request.url.path[:200], str(status), str(state.get("detail", ""))
            )
        except JournalError as error:
            _LOG.error("the audit could not be written", who=who, path=request.url.path, error=str(error))
