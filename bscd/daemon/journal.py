"""The journal: jobs and their outcomes, and who asked for what; what is saved outlasts a crash."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from sqlalchemy import create_engine, delete, event, insert, select, text
from sqlalchemy.dialects.sqlite import insert as upsert
from sqlalchemy.engine import Connection, Engine
from sqlalchemy.exc import DatabaseError, SQLAlchemyError

from bscd.daemon.documents import AuditDocument, JobDocument, JobStatus
from bscd.daemon.errors import UnknownNameError
from bscd.daemon.journal_tables import AUDIT, JOBS, KEYS, METADATA, VERSION
from bscd.errors import BscdError, InputError

#: How long an Idempotency-Key is remembered.
KEY_LIFE_S = 24 * 3600.0

_BUSY_S = 10.0
_LONGEST_DETAIL = 2000


class JournalError(BscdError):
    """The journal could not be written; the disk may be full."""


class Journal:
    """An SQLite file; safe to use from any thread.

    A damaged file is kept aside under another name and a new one begun, which `problem` tells. Raises `InputError` for
    the file of a newer version, or where it can not be written.
    """

    def __init__(self, path: Path, now_s: Callable[[], float] = time.time) -> None:
        self.path, self._now_s = path, now_s
        self.problem = ""
        try:
            self._engine = _opened(path)
        except DatabaseError as error:
            if "not a database" not in str(error) and "malformed" not in str(error):
                raise InputError(f"{path}: the journal can not be used ({error.orig})") from error
            aside = path.with_name(f"{path.stem}-damaged-{datetime.now(UTC):%Y%m%dT%H%M%S}{path.suffix}")
            path.rename(aside)
            for ending in ("-wal", "-shm"):
                beside = path.with_name(path.name + ending)
                if beside.exists():
                    beside.rename(aside.with_name(aside.name + ending))
            self.problem = f"the journal was damaged and is kept as {aside.name}; a new one was begun"
            self._engine = _opened(path)

    def save(self, job: JobDocument) -> None:
        """Keep a job as it is now; on the disk when this returns. Raises `JournalError`."""
        row = {
            "id": job.id,
            "status": job.status.value,
            "place": job.place,
            "created_at": job.created_at.isoformat(),
            "document": job.model_dump_json(),
        }
        changed = {name: row[name] for name in ("status", "place", "document")}
        with self._writing() as connection:
            connection.execute(upsert(JOBS).values(**row).on_conflict_do_update(index_elements=["id"], set_=changed))

    def job(self, job_id: str) -> JobDocument:
        """A job. Raises `UnknownNameError`."""
        with self._engine.connect() as connection:
            found = connection.execute(select(JOBS.c.document).where(JOBS.c.id == job_id)).scalar()
        if found is None:
            raise UnknownNameError(f"job {job_id[:80]!r}: there is none of that name")
        return _job(found)

    def jobs(self, status: JobStatus | None = None, limit: int = 100, before: str | None = None) -> list[JobDocument]:
        """The newest first; ``before`` a job, to page on."""
        query = select(JOBS.c.document).order_by(JOBS.c.number.desc()).limit(limit)
        if status is not None:
            query = query.where(JOBS.c.status == status.value)
        if before is not None:
            number = select(JOBS.c.number).where(JOBS.c.id == before).scalar_subquery()
            query = query.where(JOBS.c.number < number)
        return [_job(document) for document in self._documents(query)]

    def queue(self) -> list[JobDocument]:
        """Those that wait, in the order in which they came."""
        query = select(JOBS.c.document).where(JOBS.c.status == JobStatus.QUEUED.value).order_by(JOBS.c.number)
        return [_job(document) for document in self._documents(query)]

    def reconcile(self, reason: str) -> list[JobDocument]:
        """After a restart: what ran or waited for the operator was interrupted; what waited in line still does."""
        ended = [status.value for status in JobStatus if status.ended]
        query = (
            select(JOBS.c.document)
            .where(JOBS.c.status.not_in([*ended, JobStatus.QUEUED.value]))
            .order_by(JOBS.c.number)
        )
        interrupted = [
            _job(document).model_copy(
                update={
                    "status": JobStatus.INTERRUPTED,
                    "reason": reason,
                    "prompt": None,
                    "ended_at": datetime.fromtimestamp(self._now_s(), UTC),
                }
            )
            for document in self._documents(query)
        ]
        for job in interrupted:
            self.save(job)
        return interrupted

    def audit(self, who: str, action: str, target: str, outcome: str, detail: str = "") -> None:
        """Note who asked for what, and what came of it."""
        now = datetime.fromtimestamp(self._now_s(), UTC).isoformat()
        row = {"time": now, "who": who, "action": action, "target": target, "outcome": outcome}
        with self._writing() as connection:
            connection.execute(insert(AUDIT).values(**row, detail=detail[:_LONGEST_DETAIL]))

    def audits(self, limit: int = 100) -> list[AuditDocument]:
        """The newest first."""
        with self._engine.connect() as connection:
            rows = connection.execute(select(AUDIT).order_by(AUDIT.c.id.desc()).limit(limit)).mappings()
            return [AuditDocument.model_validate(dict(row)) for row in rows]

    def remember(self, key: str, fingerprint: str, job_id: str) -> None:
        """Keep an Idempotency-Key for a day."""
        now_s = self._now_s()
        row = {"key": key, "fingerprint": fingerprint, "job_id": job_id, "since_s": now_s}
        with self._writing() as connection:
            connection.execute(delete(KEYS).where(KEYS.c.since_s < now_s - KEY_LIFE_S))
            connection.execute(upsert(KEYS).values(**row).on_conflict_do_update(index_elements=["key"], set_=row))

    def recall(self, key: str) -> tuple[str, str] | None:
        """Fingerprint and job of an Idempotency-Key, None for one that is new or too old."""
        query = select(KEYS.c.fingerprint, KEYS.c.job_id).where(
            KEYS.c.key == key, KEYS.c.since_s >= self._now_s() - KEY_LIFE_S
        )
        with self._engine.connect() as connection:
            row = connection.execute(query).first()
        return None if row is None else (str(row[0]), str(row[1]))

    def close(self) -> None:
        """Close the file."""
        self._engine.dispose()

    @contextmanager
    def _writing(self) -> Iterator[Connection]:
        try:
            with self._engine.begin() as connection:
                yield connection
        except SQLAlchemyError as error:
            raise JournalError(f"{self.path}: the journal can not be written ({error}); is the disk full?") from error

    def _documents(self, query: Any) -> list[str]:
        with self._engine.connect() as connection:
            return list(connection.execute(query).scalars())


def _version(path: Path) -> int:
    """Of the file's layout; 0 where there is none yet. Changes nothing."""
    if not path.exists():
        return 0
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=_BUSY_S)) as connection:
        try:
            return int(connection.execute("PRAGMA user_version").fetchone()[0])
        except sqlite3.DatabaseError:  # whoever opens it to write says what is wrong
            return 0


def _opened(path: Path) -> Engine:
    if (version := _version(path)) > VERSION:
        raise InputError(
            f"{path}: is the journal of a newer bscd (version {version}, this one knows {VERSION}); "
            f"install that one, or name another data folder"
        )
    engine = create_engine(f"sqlite:///{path}", connect_args={"timeout": _BUSY_S, "check_same_thread": False})

    @event.listens_for(engine, "connect")
    def durable(connection: Any, _: Any) -> None:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")

    try:
        with engine.begin() as connection:
            METADATA.create_all(connection)
            connection.execute(text(f"PRAGMA user_version = {VERSION}"))
            connection.execute(select(JOBS.c.id).limit(1)).all()
    except SQLAlchemyError:
        engine.dispose()
        raise
    return engine


def _job(document: str) -> JobDocument:
    try:
        return JobDocument.model_validate_json(document)
    except ValidationError as error:
        raise InputError(f"the journal: holds a job that this version does not know: {error}") from error
