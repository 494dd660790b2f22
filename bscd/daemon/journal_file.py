"""The journal's file: its tables, the version of their layout, and how it is opened, or kept aside where damaged."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import Any

from sqlalchemy import Column, Float, Index, Integer, MetaData, String, Table, Text, create_engine, event, text
from sqlalchemy.engine import Engine
from sqlalchemy.exc import SQLAlchemyError

from bscd.errors import InputError

#: How long one connection waits for another, s.
BUSY_S = 10.0

#: SQLite's codes (sqlite.org/rescode.html) for a file that is not what it should be, and what to do about each.
_DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
_ADVICE = {
    sqlite3.SQLITE_FULL: "make room on the disk",
    sqlite3.SQLITE_IOERR: "see whether the disk is full or failing",
    sqlite3.SQLITE_BUSY: "end what else has it open",
    sqlite3.SQLITE_READONLY: "see that its folder can be written",
    **dict.fromkeys(_DAMAGED, "restart the daemon, which keeps the damaged file aside and begins a new one"),
}

#: Of the tables' layout; the file has it as its ``user_version``.
VERSION = 1

METADATA = MetaData()

JOBS = Table(
    "jobs",
    METADATA,
    Column("number", Integer, primary_key=True, autoincrement=True),
    Column("id", String, nullable=False, unique=True),
    Column("status", String, nullable=False, index=True),
    Column("place", String, nullable=False),
    Column("created_at", String, nullable=False),
    Column("document", Text, nullable=False),
)

AUDIT = Table(
    "audit",
    METADATA,
    Column("id", Integer, primary_key=True, autoincrement=True),
    Column("time", String, nullable=False),
    Column("who", String, nullable=False),
    Column("action", String, nullable=False),
    Column("target", String, nullable=False),
    Column("outcome", String, nullable=False),
    Column("detail", Text, nullable=False),
)

KEYS = Table(
    "idempotency",
    METADATA,
    Column("key", String, primary_key=True),
    Column("fingerprint", String, nullable=False),
    Column("job_id", String, nullable=False),
    Column("since_s", Float, nullable=False),
)

Index("idempotency_age", KEYS.c.since_s)
Index("jobs_age", JOBS.c.created_at, JOBS.c.number)


def opened(path: Path, now: datetime) -> tuple[Engine, str]:
    """The file, made where there is none, and what was wrong with it: "" or that a damaged one was kept aside.

    ``now`` (UTC) names the one kept aside. Raises `InputError` for the file of a newer version, which is left as it
    is, and where the path can not be used.
    """
    problem = ""
    try:
        if damage := _damage(path):
            aside = _kept_aside(path, now)
            problem = f"{path}: the journal was damaged ({damage}) and is kept as {aside.name}; a new one was begun"
        return _engine(path), problem
    except (sqlite3.Error, SQLAlchemyError, OSError) as error:
        raise InputError(
            f"{path}: the journal can not be used ({sentence(error)}); see that its folder is there and can be written"
        ) from error


def sentence(error: Exception) -> str:
    """What went wrong, without the statement and the values that SQLAlchemy adds to it."""
    told = str(getattr(error, "orig", None) or error)
    return told.splitlines()[0] if told else type(error).__name__


def advice(error: Exception) -> str:
    """What to do about an error of a file in use."""
    return _ADVICE.get(_code(error), "see the daemon's log")


def _code(error: Exception) -> int:
    """SQLite's primary result code, 0 where the error is not of SQLite."""
    return getattr(getattr(error, "orig", error), "sqlite_errorcode", 0) & 0xFF


def _damage(path: Path) -> str:
    """What is wrong inside the file; "" for none. Only reads. Raises `InputError` for that of a newer version."""
    if not path.exists():
        return ""
    try:
        uri = f"{path.absolute().as_uri()}?mode=ro"
        with closing(sqlite3.connect(uri, uri=True, timeout=BUSY_S)) as connection:
            found = str(connection.execute("PRAGMA quick_check(1)").fetchone()[0])
            if found != "ok":
                return found.splitlines()[-1]
            _require_known(path, int(connection.execute("PRAGMA user_version").fetchone()[0]))
            return ""
    except sqlite3.Error as error:
        if _code(error) in _DAMAGED:
            return sentence(error)
        raise


def _require_known(path: Path, version: int) -> None:
    if version > VERSION:
        raise InputError(
            f"{path}: is the journal of a newer bscd (version {version}, this one knows {VERSION}); "
            f"install that one, or name another data folder"
        )


def _kept_aside(path: Path, now: datetime) -> Path:
    """Rename the file, under a name that no other has; what SQLite keeps beside it goes first, so none is left."""
    stem, number = f"{path.stem}-damaged-{now:%Y%m%dT%H%M%SZ}", 1
    aside = path.with_name(stem + path.suffix)
    while any(aside.with_name(aside.name + ending).exists() for ending in ("", "-wal", "-shm")):
        number += 1
        aside = path.with_name(f"{stem}-{number}{path.suffix}")
    for ending in ("-wal", "-shm", ""):
        beside = path.with_name(path.name + ending)
        if beside.exists():
            beside.rename(aside.with_name(aside.name + ending))
    return aside


def _engine(path: Path) -> Engine:
    engine = create_engine(f"sqlite:///{path}", connect_args={"timeout": BUSY_S, "check_same_thread": False})

    @event.listens_for(engine, "connect")
    def durable(connection: Any, _: Any) -> None:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")

    try:
        with engine.begin() as connection:
            version = int(connection.execute(text("PRAGMA user_version")).scalar_one())
            _require_known(path, version)
            METADATA.create_all(connection)
            if version != VERSION:
                connection.execute(text(f"PRAGMA user_version = {VERSION}"))
    except BaseException:
        engine.dispose()
        raise
    return engine
