"""Who asks, and what they may: keys with roles, tokens for streams, control of the rig; closed to other origins."""

from __future__ import annotations

import ipaddress
from typing import Annotated
from urllib.parse import urlsplit

import structlog
from fastapi import Depends, Request
from fastapi.security import APIKeyHeader, HTTPBearer

from bscd.api.problems import RefusedError
from bscd.daemon.daemon import Daemon
from bscd.daemon.jobs import utc_now
from bscd.daemon.keys import LOCAL, KeyDocument, OneShotTokens, Role, operator_name

_LOG = structlog.get_logger(__name__)

#: For the documentation: how a key is sent. They are looked at here, not by FastAPI.
BEARER = HTTPBearer(auto_error=False, description="an API key of bscd keys add")
OPERATOR = APIKeyHeader(name="X-Operator", auto_error=False, description="whose hand it is, where no keys are needed")


def is_loopback(host: str) -> bool:
    """Whether an address reaches this computer alone."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Gate:
    """Decides who a request is from. ``open_to_all`` while no keys are needed: loopback, and none were made."""

    def __init__(self, daemon: Daemon) -> None:
        self._daemon = daemon
        self.tokens = OneShotTokens()

    @property
    def open_to_all(self) -> bool:
        """Whether nobody needs a key."""
        return is_loopback(self._daemon.settings.host) and self._daemon.keys.empty

    def admit(self, key: str) -> str | None:
        """Whose e-stop it is: a key's holder of any role, `LOCAL` where nobody needs a key; None: it needs one.

        A file of keys that can not be read keeps nobody of this computer from stopping, nor a key that it held before.
        """
        try:
            if self.open_to_all:
                return LOCAL
            holder = self._daemon.keys.find(key)
        except Exception as error:
            _LOG.error("the keys can not be read; the e-stop is let through where it may be", error=str(error))
            if is_loopback(self._daemon.settings.host):
                return LOCAL
            holder = self._daemon.keys.find(key, last_read=True)
        return None if holder is None else holder.name

    def holder(self, request: Request, *, token: str | None = None) -> KeyDocument:
        """Who asks. Raises `RefusedError` 401."""
        if token is not None:
            holder = self.tokens.redeem(token)
            if holder is None:
                raise RefusedError(401, "unauthorised", "the token was used already or is too old; ask for another")
            return holder
        if request.headers.get("Authorization"):
            holder = self._daemon.keys.find(_bearer(request))
            if holder is None:
                raise _no_key(_UNKNOWN)
            return holder
        if not self.open_to_all:
            raise _no_key(_NEEDED)
        name = operator_name(request.headers.get("X-Operator", LOCAL))
        if name is None:
            raise RefusedError(422, "input", "X-Operator: is no name; use letters, digits, spaces and . _ @ -")
        return KeyDocument(name=name, role="admin", created_at=utc_now())


_UNKNOWN = "the key is not known, or was revoked"
_NEEDED = "a key is needed: Authorization: Bearer KEY; an admin makes one with bscd keys add"


def _bearer(request: Request) -> str:
    """The key that was sent, "" for none."""
    scheme, _, key = request.headers.get("Authorization", "").partition(" ")
    return key.strip() if scheme.lower() == "bearer" else ""


def _no_key(detail: str) -> RefusedError:
    return RefusedError(401, "unauthorised", detail, headers={"WWW-Authenticate": "Bearer"})


def gate_of(request: Request) -> Gate:
    """The app's gate."""
    return request.app.state.gate


def daemon_of(request: Request) -> Daemon:
    """The app's daemon."""
    return request.app.state.daemon


def _who(request: Request, role: Role, *, token: str | None = None) -> KeyDocument:
    _require_own_origin(request)
    holder = gate_of(request).holder(request, token=token)
    request.state.who = holder.name
    if not holder.may(role):
        raise RefusedError(
            403, "forbidden", f"{holder.name} is {holder.role}; this needs {role}; ask an admin for such a key"
        )
    return holder


def _require_own_origin(request: Request) -> None:
    """No page of another host acts through somebody's browser; CORS stays closed."""
    origin = request.headers.get("Origin")
    if origin is not None and request.method not in ("GET", "HEAD") and _place(origin) != request.headers.get("Host"):
        raise RefusedError(403, "forbidden", f"a page of {origin[:80]} may not do this; open the daemon's own page")


def _place(origin: str) -> str | None:
    try:
        return urlsplit(origin).netloc
    except ValueError:
        return None


async def stopper(request: Request) -> str:
    """Who stops everything: refused to a wrong key, where one is needed, and to another host's page alone."""
    _require_own_origin(request)
    name = gate_of(request).admit(_bearer(request))
    if name is None:
        raise _no_key(_UNKNOWN if request.headers.get("Authorization") else _NEEDED)
    if name == LOCAL:
        name = operator_name(request.headers.get("X-Operator", LOCAL)) or LOCAL
    request.state.who = name
    return name


async def viewer(request: Request) -> KeyDocument:
    """Who may look."""
    return _who(request, "viewer")


async def stream_viewer(request: Request, token: str | None = None) -> KeyDocument:
    """Who may look; by a one-shot token too, where a header can not be sent."""
    return _who(request, "viewer", token=token)


async def operator(request: Request) -> KeyDocument:
    """Who may do something, whoever is in control."""
    return _who(request, "operator")


async def admin(request: Request) -> KeyDocument:
    """Who may do all."""
    return _who(request, "admin")


async def in_control(request: Request) -> KeyDocument:
    """An operator who is in control of the rig, or is so now that nobody is."""
    holder = _who(request, "operator")
    daemon_of(request).lease.require(holder.name)
    return holder


Stopper = Annotated[str, Depends(stopper)]
Viewer = Annotated[KeyDocument, Depends(viewer)]
StreamViewer = Annotated[KeyDocument, Depends(stream_viewer)]
Operator = Annotated[KeyDocument, Depends(operator)]
Admin = Annotated[KeyDocument, Depends(admin)]
InControl = Annotated[KeyDocument, Depends(in_control)]
TheDaemon = Annotated[Daemon, Depends(daemon_of)]
