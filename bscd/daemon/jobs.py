"""The jobs as they are now: each change is journalled where it must outlast a crash, and told."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import structlog

from bscd.daemon.documents import JobDocument, JobProgress
from bscd.daemon.events import EventLog
from bscd.daemon.journal import Journal, JournalError, RequestKey
from bscd.procedures import Progress

_LOG = structlog.get_logger(__name__)

#: Progress is told so often at most; it is not journalled: what a scan has recorded is in its file.
_TELL_S = 0.2


@dataclass
class _Pace:
    """Since when a stretch of work goes on, to estimate the time left."""

    unit: str = ""
    total: int = 0
    first: int = 0
    since_s: float = 0.0
    told_s: float = -math.inf


class Jobs:
    """All jobs of the journal; those that have not ended are held here. Safe to use from any thread."""

    def __init__(self, journal: Journal, events: EventLog) -> None:
        self._journal, self._events = journal, events
        self._lock = threading.RLock()
        self._open: dict[str, JobDocument] = {}
        self._paces: dict[str, _Pace] = {}

    def add(self, job: JobDocument, key: RequestKey | None = None) -> JobDocument:
        """A new one, with the key of its request where it has one, or one that is begun again."""
        with self._lock:
            self._journal.save(job, key)
            if not job.status.ended:
                self._open[job.id] = job
            self._tell(job)
            return job

    def get(self, job_id: str) -> JobDocument:
        """As it is now. Raises `UnknownNameError`."""
        with self._lock:
            return self._open.get(job_id) or self._journal.job(job_id)

    def open(self) -> list[JobDocument]:
        """Those that have not ended, oldest first."""
        with self._lock:
            return list(self._open.values())

    def change(self, job_id: str, **changes: Any) -> JobDocument:
        """Change and journal it; one that ends is let go of.

        A journal that can not be written (a full disk) is told, and ends no job.
        """
        with self._lock:
            job = self.get(job_id).model_copy(update=changes)
            self._save(job)
            if job.status.ended:
                self._open.pop(job_id, None)
                self._paces.pop(job_id, None)
            else:
                self._open[job_id] = job
            self._tell(job)
            return job

    def progress(self, job_id: str, now: Progress, unit: str, prefix: str = "") -> None:
        """Keep where it is; told now and then."""
        with self._lock:
            job = self._open.get(job_id)
            if job is None:
                return
            pace, now_s = self._paces.setdefault(job_id, _Pace()), time.monotonic()
            if (pace.unit, pace.total) != (unit, now.total) or now.done < pace.first:
                self._paces[job_id] = pace = _Pace(unit, now.total, now.done, now_s)
            done = now.done - pace.first
            left_s = (now_s - pace.since_s) / done * (now.total - now.done) if done > 0 else None
            told = JobProgress(done=now.done, total=now.total, unit=unit, doing=f"{prefix}{now.doing}", left_s=left_s)
            self._open[job_id] = job = job.model_copy(update={"progress": told})
            if now_s - pace.told_s >= _TELL_S or now.done >= now.total:
                pace.told_s = now_s
                self._tell(job)

    def begin_stretch(self, job_id: str) -> None:
        """What comes now is other work: what is known of its progress so far says nothing of it."""
        with self._lock:
            self._paces.pop(job_id, None)
            job = self._open.get(job_id)
            if job is not None and job.progress is not None:
                self._open[job_id] = job.model_copy(update={"progress": None})

    def warn_later(self, job_id: str, text: str) -> None:
        """Keep a warning with a job that has ended."""
        with self._lock:
            job = self.get(job_id)
            self.change(job_id, warnings=(*job.warnings, text))
            self._events.publish("warning", {"job": job_id, "text": text})

    def warn(self, job_id: str, text: str) -> None:
        """Keep a warning with it."""
        with self._lock:
            job = self._open.get(job_id)
            if job is not None and text not in job.warnings:
                self._open[job_id] = job = job.model_copy(update={"warnings": (*job.warnings, text)})
                self._events.publish("warning", {"job": job_id, "text": text})
                self._tell(job)

    def _save(self, job: JobDocument) -> None:
        try:
            self._journal.save(job)
        except JournalError as error:
            _LOG.error("the journal could not be written", job=job.id, error=str(error))
            self._events.publish("warning", {"job": job.id, "text": str(error)})

    def _tell(self, job: JobDocument) -> None:
        self._events.publish("job", job.model_dump(mode="json"))


def cleaned(figures: dict[str, Any]) -> dict[str, Any]:
    """Figures as JSON can have them: what is not known is null."""
    return {
        name: cleaned(value)
        if isinstance(value, dict)
        else None
        if isinstance(value, float) and not math.isfinite(value)
        else value
        for name, value in figures.items()
    }


def utc_now() -> datetime:
    """The wall clock."""
    return datetime.now(UTC)
