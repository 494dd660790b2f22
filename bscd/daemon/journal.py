"""The journal: jobs and their outcomes, and who asked for what; what is saved outlasts a crash."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from sqlalchemy import delete, insert, select, tuple_
from sqlalchemy.dialects.sqlite import insert as upsert
from sqlalchemy.engine import Connection
from sqlalchemy.exc import SQLAlchemyError

from bscd.daemon.documents import AuditDocument, JobDocument, JobStatus
from bscd.daemon.errors import UnknownNameError
from bscd.daemon.journal_file import AUDIT, BUSY_S, JOBS, KEYS, advice, opened, sentence
from bscd.errors import BscdError, InputError

#: How long an Idempotency-Key is remembered.
KEY_LIFE_S = 24 * 3600.0

_LONGEST_DETAIL = 2000


class JournalError(BscdError):
    """The journal could not be written or read while in use: the disk is full, the file is damaged or closed."""


@dataclass(frozen=True)
class RequestKey:
    """An Idempotency-Key, and the fingerprint of what was asked for with it."""

    key: str
    fingerprint: str


class Journal:
    """An SQLite file; safe to use from any thread.

    A damaged file is kept aside under another name and a new one begun, which `problem` tells. Raises `InputError` for
    the file of a newer version, or where it can not be written. Every method raises `JournalError` when the file can
    not be written or read. ``now_s`` is the time, s since 1970.
    """

    def __init__(self, path: Path, now_s: Callable[[], float] = time.time) -> None:
        self.path, self._now_s = path, now_s
        self._turn, self._closed = threading.Lock(), False
        self._engine, self.problem = opened(path, self._now())

    def save(self, job: JobDocument, key: RequestKey | None = None) -> None:
        """Keep a job as it is now, and ``key`` for a day, both or neither; on the disk when this returns."""
        row = {
            "id": job.id,
            "status": job.status.value,
            "place": job.place,
            "created_at": _sortable(job.created_at),
            "document": job.model_dump_json(),
        }
        changed = {name: row[name] for name in ("status", "place", "document")}
        with self._writing() as connection:
            connection.execute(upsert(JOBS).values(**row).on_conflict_do_update(index_elements=["id"], set_=changed))
            if key is not None:
                self._remember(connection, key, job.id)

    def job(self, job_id: str) -> JobDocument:
        """A job. Raises `UnknownNameError`."""
        with self._reading() as connection:
            found = connection.execute(select(JOBS.c.document).where(JOBS.c.id == job_id)).scalar()
        if found is None:
            raise UnknownNameError(f"job {job_id[:80]!r}: there is none of that name")
        return _job(found)

    def jobs(self, status: JobStatus | None = None, limit: int = 100, before: str | None = None) -> list[JobDocument]:
        """The newest first, of the same time the last saved; ``before`` a job, to page on.

        Raises `UnknownNameError` when there is no such job to page on from.
        """
        age = tuple_(JOBS.c.created_at, JOBS.c.number)
        query = select(JOBS.c.document).order_by(JOBS.c.created_at.desc(), JOBS.c.number.desc()).limit(limit)
        if status is not None:
            query = query.where(JOBS.c.status == status.value)
        with self._reading() as connection:
            if before is not None:
                place = connection.execute(select(JOBS.c.created_at, JOBS.c.number).where(JOBS.c.id == before)).first()
                if place is None:
                    raise UnknownNameError(f"job {before[:80]!r}: there is none of that name to list on from")
                query = query.where(age < tuple_(*place))
            return [_job(document) for document in connection.execute(query).scalars()]

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
                    "ended_at": self._now(),
                }
            )
            for document in self._documents(query)
        ]
        for job in interrupted:
            self.save(job)
        return interrupted

    def audit(self, who: str, action: str, target: str, outcome: str, detail: str = "") -> None:
        """Note who asked for what, and what came of it."""
        row = {"time": self._now().isoformat(), "who": who, "action": action, "target": target, "outcome": outcome}
        with self._writing() as connection:
            connection.execute(insert(AUDIT).values(**row, detail=detail[:_LONGEST_DETAIL]))

    def audits(self, limit: int = 100) -> list[AuditDocument]:
        """The newest first."""
        with self._reading() as connection:
            rows = connection.execute(select(AUDIT).order_by(AUDIT.c.id.desc()).limit(limit)).mappings()
            return [AuditDocument.model_validate(dict(row)) for row in rows]

    def recall(self, key: str) -> tuple[str, str] | None:
        """Fingerprint and job of an Idempotency-Key, None for one that is new or too old."""
        query = select(KEYS.c.fingerprint, KEYS.c.job_id).where(
            KEYS.c.key == key, KEYS.c.since_s >= self._now_s() - KEY_LIFE_S
        )
        with self._reading() as connection:
            row = connection.execute(query).first()
        return None if row is None else (str(row[0]), str(row[1]))

    def close(self) -> None:
        """Close the file, after whoever writes has written; what comes later is refused with `JournalError`."""
        got = self._turn.acquire(timeout=2 * BUSY_S)
        self._closed = True
        self._engine.dispose()
        if got:
            self._turn.release()

    def _remember(self, connection: Connection, key: RequestKey, job_id: str) -> None:
        now_s = self._now_s()
        row = {"key": key.key, "fingerprint": key.fingerprint, "job_id": job_id, "since_s": now_s}
        connection.execute(delete(KEYS).where(KEYS.c.since_s < now_s - KEY_LIFE_S))
        connection.execute(upsert(KEYS).values(**row).on_conflict_do_update(index_elements=["key"], set_=row))

    def _now(self) -> datetime:
        return datetime.fromtimestamp(self._now_s(), UTC)

    @contextmanager
    def _writing(self) -> Iterator[Connection]:
        """One writer at a time, in turn: SQLite's own waiting is by trial, and may pass one over."""
        if not self._turn.acquire(timeout=2 * BUSY_S):
            raise JournalError(
                f"{self.path}: the journal is still being written by another; see whether the disk fails"
            )
        try:
            with self._telling("written"), self._engine.begin() as connection:
                yield connection
        finally:
            self._turn.release()

    @contextmanager
    def _reading(self) -> Iterator[Connection]:
        with self._telling("read"), self._engine.connect() as connection:
            yield connection

    @contextmanager
    def _telling(self, what: str) -> Iterator[None]:
        if self._closed:
            raise JournalError(f"{self.path}: the journal can not be {what}, it is closed; start the daemon again")
        try:
            yield
        except SQLAlchemyError as error:
            told = f"{self.path}: the journal can not be {what} ({sentence(error)}); {advice(error)}"
            raise JournalError(told) from error

    def _documents(self, query: Any) -> list[str]:
        with self._reading() as connection:
            return list(connection.execute(query).scalars())


def _sortable(time: datetime) -> str:
    """A time as text that sorts as the times do: UTC, always with microseconds."""
    return time.astimezone(UTC).isoformat(timespec="microseconds")


def _job(document: str) -> JobDocument:
    try:
        return JobDocument.model_validate_json(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(
            f"the journal: holds a job that this version of bscd does not know ({where}: {first['msg']}); "
            f"install the version that made it, or name another data folder"
        ) from error
