"""API keys: made here, kept as hashes, told apart by name and role; and tokens that open one stream once."""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import re
import secrets
import tempfile
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field

from bscd.daemon.documents import Document
from bscd.errors import InputError

Role = Literal["viewer", "operator", "admin"]
ROLES: tuple[Role, ...] = ("viewer", "operator", "admin")
"""Each may do what those before it may."""

_KEY = re.compile(r"bscd_[0-9a-f]{8}_[A-Za-z0-9_-]{43}")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._@-]{0,79}")
_OPERATOR = re.compile(r"[\w][\w .@-]{0,79}")

LOCAL = "local"
"""Who asks where nobody needs a key and no name is given; no key is called so."""


def operator_name(told: str) -> str | None:
    """The name of who asks without a key, None for what is no name."""
    return told if _OPERATOR.fullmatch(told) else None


class KeyDocument(Document):
    """Whose key, and what it lets them do."""

    name: str
    role: Role
    created_at: datetime

    def may(self, role: Role) -> bool:
        """Whether it lets them do what that role may."""
        return ROLES.index(self.role) >= ROLES.index(role)


class _Kept(KeyDocument):
    """A line of the file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str = Field(pattern=r"^[0-9a-f]{8}$")
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")


class KeyStore:
    """The keys in a file that its owner alone can read; read again when it changes. Safe to use from any thread.

    A key is 256 random bits, so that a plain hash tells nothing of it. Raises `InputError` for a file that is no list
    of keys.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._stamp: tuple[int, int] | None = None
        self._keys: dict[str, _Kept] = {}

    @property
    def empty(self) -> bool:
        """Whether there is no key."""
        return not self._known()

    def add(self, name: str, role: Role) -> str:
        """A new key; shown here and never again. Raises `InputError` for a name that has one, or is none."""
        if _NAME.fullmatch(name) is None or name == LOCAL:
            raise InputError(f"{name[:80]!r}: is no name for a key; use letters, digits, spaces and . _ @ -")
        if role not in ROLES:
            raise InputError(f"{role!r}: is no role; choose {', '.join(ROLES)}")
        with self._lock:
            keys = dict(self._read())
            if any(kept.name == name for kept in keys.values()):
                raise InputError(f"{name}: has a key already; revoke it first, or choose another name")
            key_id, secret = secrets.token_hex(4), secrets.token_urlsafe(32)
            key = f"bscd_{key_id}_{secret}"
            keys[key_id] = _Kept(id=key_id, name=name, role=role, created_at=datetime.now(UTC), sha256=_hashed(key))
            self._write(keys)
            return key

    def revoke(self, name: str) -> None:
        """From now on the key of that name opens nothing. Raises `InputError` when there is none."""
        with self._lock:
            keys = {key_id: kept for key_id, kept in self._read().items() if kept.name != name}
            if len(keys) == len(self._keys):
                raise InputError(f"{name}: has no key; bscd keys list shows who has")
            self._write(keys)

    def list(self) -> list[KeyDocument]:
        """Who has keys, oldest first."""
        return [
            KeyDocument(name=kept.name, role=kept.role, created_at=kept.created_at)
            for kept in sorted(self._known().values(), key=lambda kept: kept.created_at)
        ]

    def find(self, key: str, *, last_read: bool = False) -> KeyDocument | None:
        """Whose key that is, None for one that is none (any more).

        With ``last_read`` the keys that were read last count where the file can not be read now.
        """
        if _KEY.fullmatch(key) is None:
            return None
        kept = self._known(last_read=last_read).get(key.split("_")[1])
        if kept is None or not hmac.compare_digest(kept.sha256, _hashed(key)):
            return None
        return KeyDocument(name=kept.name, role=kept.role, created_at=kept.created_at)

    def _known(self, *, last_read: bool = False) -> dict[str, _Kept]:
        with self._lock:
            try:
                return self._read()
            except InputError:
                if not last_read:
                    raise
                return self._keys

    def _read(self) -> dict[str, _Kept]:
        try:
            stat = self.path.stat()
        except FileNotFoundError:
            self._stamp, self._keys = None, {}
            return self._keys
        except OSError as error:
            raise InputError(f"{self.path}: can not be read ({error.strerror}); correct its folder's rights") from error
        stamp = (stat.st_mtime_ns, stat.st_ino)
        if stamp != self._stamp:
            try:
                told: Any = json.loads(self.path.read_text(encoding="utf-8"))
                kept = [_Kept.model_validate(one) for one in told["keys"]]
            except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
                raise InputError(f"{self.path}: is no file of keys; move it away and add the keys again") from error
            self._keys, self._stamp = {one.id: one for one in kept}, stamp
        return self._keys

    def _write(self, keys: dict[str, _Kept]) -> None:
        """In its place at once, or not at all; readable to its owner alone from the first byte."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        told = {"keys": [kept.model_dump(mode="json") for kept in keys.values()]}
        handle, name = tempfile.mkstemp(dir=self.path.parent, prefix=".keys-")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                json.dump(told, file, indent=1)
                file.flush()
                os.fsync(file.fileno())
            os.replace(name, self.path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
        self._stamp = None
        self._read()


class OneShotTokens:
    """Tokens for what takes no header (an image's or an event stream's address): each opens one once, and soon."""

    def __init__(self, lifetime_s: float = 30.0, clock: Callable[[], float] = time.monotonic, most: int = 1000) -> None:
        self.lifetime_s, self._clock, self._most = lifetime_s, clock, most
        self._lock = threading.Lock()
        self._issued: dict[str, tuple[float, KeyDocument]] = {}

    def issue(self, holder: KeyDocument) -> str:
        """A token that lets through what ``holder`` may."""
        token = secrets.token_urlsafe(32)
        with self._lock:
            now_s = self._clock()
            self._issued = {one: kept for one, kept in self._issued.items() if kept[0] > now_s}
            while len(self._issued) >= self._most:
                self._issued.pop(next(iter(self._issued)))
            self._issued[_hashed(token)] = now_s + self.lifetime_s, holder
        return token

    def redeem(self, token: str) -> KeyDocument | None:
        """Whose it is; None for one that is unknown, used or too old."""
        with self._lock:
            kept = self._issued.pop(_hashed(token), None)
            return kept[1] if kept is not None and kept[0] > self._clock() else None


def _hashed(key: str) -> str:
    return hashlib.sha256(key.encode()).hexdigest()
