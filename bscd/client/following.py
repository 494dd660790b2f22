"""A job's events as documents: what both clients do with a stream of events."""

from __future__ import annotations

import json

from httpx_sse import ServerSentEvent

from bscd.daemon.documents import JobDocument

#: Events are pinged every 15 s; a stream that is silent for longer is dead.
SILENCE_S = 45.0

#: Between two attempts to reach a daemon that went away.
AGAIN_S = 1.0


class JobFollower:
    """Picks one job's documents out of the events; ``last_id`` is where to go on after a broken stream."""

    def __init__(self, job_id: str) -> None:
        self._job_id = job_id
        self.last_id: str | None = None
        self._told: JobDocument | None = None

    @property
    def headers(self) -> dict[str, str]:
        """For the next stream."""
        return {} if self.last_id is None else {"Last-Event-ID": self.last_id}

    def taken(self, event: ServerSentEvent) -> JobDocument | None:
        """The job's document where the event has one that is new."""
        if event.id:
            self.last_id = event.id
        if event.event != "job":
            return None
        data = json.loads(event.data)
        if data.get("id") != self._job_id:
            return None
        data.pop("time", None)
        return self.news(JobDocument.model_validate(data))

    def news(self, job: JobDocument) -> JobDocument | None:
        """The document unless it was told already."""
        if job == self._told:
            return None
        self._told = job
        return job
