"""The engine: one job at a time on the bench, one at the desk, the others in line; each ends with its reason."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Callable, Collection

from bscd.daemon.bench import Bench
from bscd.daemon.documents import JobDocument, JobStatus, RigState
from bscd.daemon.errors import IllegalRequestError
from bscd.daemon.events import EventLog
from bscd.daemon.files import DataFolder
from bscd.daemon.jobs import Jobs, utc_now
from bscd.daemon.journal import Journal, RequestKey
from bscd.daemon.prompts import Prompts
from bscd.daemon.recipes import DESK, AnyRecipe, Campaign, Home
from bscd.daemon.running.control import JobControl
from bscd.daemon.states import RigStates
from bscd.daemon.workshop import Workshop
from bscd.errors import InputError

#: States in which a job for the bench may be asked for; in the others it could not begin.
_TAKES_JOBS = (RigState.IDLE, RigState.RUNNING, RigState.PAUSING, RigState.PAUSED, RigState.STOPPING)


class Engine:
    """Runs jobs; `close` ends it. What a person asks for raises `IllegalRequestError` where it can not be now.

    Jobs that waited when an earlier daemon ended wait until somebody resumes them: nothing moves by itself.
    ``being_checked`` gives the ids of jobs whose files are in use.
    """

    def __init__(
        self,
        bench: Bench,
        files: DataFolder,
        journal: Journal,
        events: EventLog,
        states: RigStates,
        prompts: Prompts,
        *,
        reserve_bytes: int,
        queue_limit: int,
        being_checked: Callable[[], Collection[str]] = tuple,
    ) -> None:
        self._states, self._prompts, self._journal = states, prompts, journal
        self._queue_limit, self._being_checked = queue_limit, being_checked
        self.jobs = Jobs(journal, events)
        self.shop = Workshop(bench, files, self.jobs, events, states, prompts, reserve_bytes)
        for job in journal.queue():
            self.shop.held.add(job.id)
            self.jobs.add(job)
        self.shop.start()

    # what is asked

    def submit(self, recipe: AnyRecipe, operator: str, *, idempotency_key: str | None = None) -> JobDocument:
        """Put a job in line; the same key gives the same job.

        Raises `IllegalRequestError` when the rig takes none now, `InterlockError` when it can not be done,
        `InputError` for a key that was used for another recipe.
        """
        key = None
        if idempotency_key is not None:
            key = RequestKey(idempotency_key, hashlib.sha256(recipe.model_dump_json().encode()).hexdigest())
        place = "desk" if recipe.recipe in DESK else "bench"
        if (known := self._known(key)) is not None:
            return known
        self._require_place(place)
        homes = any(isinstance(job.recipe, Home) for job in self.jobs.open() if job.id not in self.shop.held)
        self.shop.require_possible(recipe, homed=homes)  # asks devices: not while others wait for their turn
        with self.shop.turn:
            if (known := self._known(key)) is not None:
                return known
            self._require_place(place)
            job = JobDocument(
                id=_new_id(),
                recipe=recipe,
                place=place,
                status=JobStatus.QUEUED,
                operator=operator,
                created_at=utc_now(),
            )
            self.jobs.add(job, key)
            self.shop.wake()
            return job

    def pause(self, job_id: str) -> JobDocument:
        """Have it stand still at its next safe point."""
        with self.shop.turn:
            job, control = self._on_the_bench(job_id, "pause", (JobStatus.RUNNING, JobStatus.WAITING))
            self._states.send("pause")
            job = self.jobs.change(job.id, status=JobStatus.PAUSING)
            control.pause()
            return job

    def resume(self, job_id: str) -> JobDocument:
        """Go on after a pause, or let one begin that waited since before a restart."""
        with self.shop.turn:
            job = self.jobs.get(job_id)
            if job.status is JobStatus.QUEUED and job_id in self.shop.held:
                self.shop.held.discard(job_id)
                self.shop.wake()
                return job
            job, control = self._on_the_bench(job_id, "resume", (JobStatus.PAUSING, JobStatus.PAUSED))
            self._states.send("resume")
            asked = self._prompts.document is not None
            job = self.jobs.change(job.id, status=JobStatus.WAITING if asked else JobStatus.RUNNING)
            control.resume()
            return job

    def stop(self, job_id: str) -> JobDocument:
        """End it at its next safe point and keep what there is; one that waits is taken out of the line.

        One that waits for a person to turn something has them leave off, and tell where it is.
        """
        job = self._end(job_id, "stop", lambda control: control.stop(), "stopped before it began")
        if self.shop.running["bench"] == job_id:
            self._prompts.withdraw()
        return job

    def abort(self, job_id: str, reason: str) -> JobDocument:
        """End it now."""
        return self._end(job_id, "abort", lambda control: control.abort(reason), reason)

    def abort_bench(self, reason: str) -> None:
        """End what is on the bench now, if anything is."""
        running = self.shop.running["bench"]
        control = None if running is None else self.shop.controls.get(running)
        if control is not None:
            control.abort(reason)

    def resume_from(self, job_id: str, step: int | None = None) -> JobDocument:
        """Begin a job again that ended early, at ``step`` (None: where it ended)."""
        job = self._ended_early(job_id)
        next_step = job.next_step if step is None else step
        if isinstance(job.recipe, Campaign) and not 0 <= (next_step or 0) < len(job.recipe.steps):
            raise InputError(f"job {job_id}: has the steps 0 to {len(job.recipe.steps) - 1}, not {next_step}")
        self.shop.require_possible(job.recipe, first_step=next_step or 0)
        with self.shop.turn:
            job = self._ended_early(job_id)
            changes = {
                "status": JobStatus.QUEUED,
                "next_step": next_step,
                "ended_at": None,
                "reason": "",
                "progress": None,
            }
            job = self.jobs.add(job.model_copy(update=changes))
            self.shop.wake()
            return job

    def confirm(self, job_id: str, prompt: int, value: float | None = None) -> JobDocument:
        """Answer the question of the job that waits."""
        job = self.jobs.get(job_id)
        if self.shop.running["bench"] != job_id:
            raise IllegalRequestError(f"job {job_id} asks nothing", job.status.value, _allowed(job))
        self._prompts.answer(prompt, value)
        return self.jobs.get(job_id)

    def prompt_changed(self) -> None:
        """A question was opened or answered."""
        with self.shop.turn:
            running = self.shop.running["bench"]
            if running is None:
                return
            prompt = self._prompts.document
            status = self.jobs.get(running).status
            if prompt is not None and status is JobStatus.RUNNING:
                self.jobs.change(running, prompt=prompt, status=JobStatus.WAITING)
            elif status is JobStatus.WAITING and prompt is None:
                self.jobs.change(running, prompt=None, status=JobStatus.RUNNING)
            elif not status.ended:
                self.jobs.change(running, prompt=prompt)

    @property
    def current(self) -> JobDocument | None:
        """The job on the bench."""
        running = self.shop.running["bench"]
        return None if running is None else self.jobs.get(running)

    def waiting(self, place: str = "bench") -> list[str]:
        """Ids of those in line, first first."""
        return [job.id for job in self.jobs.open() if job.place == place and job.status is JobStatus.QUEUED]

    def at_the_desk(self) -> list[str]:
        """Ids of the desk's job and of those in line for it."""
        running = self.shop.running["desk"]
        return ([] if running is None else [running]) + self.waiting("desk")

    def wake(self) -> None:
        """The rig's state has changed: look whether a job can begin. Waits for nobody."""
        self.shop.wake()

    def close(self) -> None:
        """End what runs, as interrupted, and join."""
        self.shop.close()

    def _known(self, key: RequestKey | None) -> JobDocument | None:
        """The job that a key was used for. Raises `InputError` when that was another recipe."""
        known = None if key is None else self._journal.recall(key.key)
        if key is None or known is None:
            return None
        if known[0] != key.fingerprint:
            raise InputError(f"Idempotency-Key {key.key[:80]}: was used for another recipe")
        return self.jobs.get(known[1])

    def _require_place(self, place: str) -> None:
        """Raise `IllegalRequestError` where no job can be taken now."""
        if place == "bench" and self._states.state not in _TAKES_JOBS:
            raise IllegalRequestError("no job can start now", self._states.state.value, self._states.allowed)
        waiting = sum(job.status is JobStatus.QUEUED for job in self.jobs.open())
        if waiting >= self._queue_limit:
            raise IllegalRequestError(f"{waiting} jobs wait already", self._states.state.value, ("stop", "abort"))

    def _ended_early(self, job_id: str) -> JobDocument:
        """A job that may begin again. Raises `IllegalRequestError` for one that may not, or not now."""
        job = self.jobs.get(job_id)
        if not job.status.ended or job.status is JobStatus.DONE:
            raise IllegalRequestError(f"job {job_id} has not ended early", job.status.value, _allowed(job))
        if job_id in self._being_checked():
            told = f"job {job_id}: its recovered run is being read through, try again in a minute"
            raise IllegalRequestError(told, job.status.value, ())
        self._require_place(job.place)
        return job

    def _on_the_bench(self, job_id: str, what: str, when: tuple[JobStatus, ...]) -> tuple[JobDocument, JobControl]:
        job = self.jobs.get(job_id)
        control = self.shop.controls.get(job_id)
        if control is None or job.place != "bench" or job.status not in when:
            raise IllegalRequestError(f"job {job_id} can not {what} now", job.status.value, _allowed(job))
        return job, control

    def _end(self, job_id: str, what: str, ask: Callable[[JobControl], None], waiting_reason: str) -> JobDocument:
        with self.shop.turn:
            job = self.jobs.get(job_id)
            if job.status is JobStatus.QUEUED and job_id not in self.shop.controls:
                self.shop.held.discard(job_id)
                status = JobStatus.STOPPED if what == "stop" else JobStatus.ABORTED
                return self.jobs.change(job_id, status=status, reason=waiting_reason, ended_at=utc_now())
            control = self.shop.controls.get(job_id)
            if control is None or job.status.ended:
                raise IllegalRequestError(f"job {job_id} can not {what} now", job.status.value, _allowed(job))
            if job.place == "bench":
                self._states.send_if_allowed("stop", f"{what} of job {job_id}")
            job = self.jobs.change(job_id, status=JobStatus.STOPPING)
        ask(control)
        return job


def _allowed(job: JobDocument) -> tuple[str, ...]:
    if job.status.ended:
        return () if job.status is JobStatus.DONE else ("resume-from",)
    if job.status is JobStatus.QUEUED:
        return ("stop", "abort")
    if job.place == "desk":
        return ("stop", "abort")
    return {
        JobStatus.RUNNING: ("pause", "stop", "abort"),
        JobStatus.WAITING: ("confirm", "pause", "stop", "abort"),
        JobStatus.PAUSING: ("resume", "stop", "abort"),
        JobStatus.PAUSED: ("resume", "stop", "abort"),
    }.get(job.status, ("abort",))


def _new_id() -> str:
    return f"{utc_now():%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"
