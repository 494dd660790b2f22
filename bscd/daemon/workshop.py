"""Where jobs are done: one on the bench, one at the desk, each on a thread of its own, the others in line."""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import Any

import structlog

from bscd.daemon.bench import Bench
from bscd.daemon.documents import JobDocument, JobStatus, LiveDocument, RigState
from bscd.daemon.errors import InterlockError
from bscd.daemon.events import EventLog
from bscd.daemon.files import DataFolder
from bscd.daemon.interlocks import Interlocks
from bscd.daemon.jobs import Jobs, cleaned, utc_now
from bscd.daemon.logs import bind_job
from bscd.daemon.prompts import Prompts
from bscd.daemon.recipes import Campaign, Recipe
from bscd.daemon.running.campaign import CampaignState, run_campaign
from bscd.daemon.running.control import JobControl
from bscd.daemon.running.live_events import live_event
from bscd.daemon.running.recipe import run_single
from bscd.daemon.running.work import Reporting, Work
from bscd.daemon.states import RigStates
from bscd.errors import BscdError
from bscd.procedures import ProcedureStoppedError, Progress
from bscd.procedures.live.messages import LiveEvent
from drivers.errors import DeviceError

_LOG = structlog.get_logger(__name__)
_JOIN_S = 60.0

#: The line is looked at so often, also when nothing was told of it.
_LOOK_S = 1.0

PLACES: tuple[str, ...] = ("bench", "desk")


class Workshop:
    """Takes jobs out of the line, once the rig is idle, and does them; `close` ends it.

    ``turn`` guards the line; ``held`` are those in it that wait for a person, ``controls`` and ``running`` belong to
    those that are done now. ``turns`` grow while a place makes progress or waits in good health.
    """

    def __init__(
        self,
        bench: Bench,
        files: DataFolder,
        jobs: Jobs,
        events: EventLog,
        states: RigStates,
        prompts: Prompts,
        reserve_bytes: int,
    ) -> None:
        self._bench, self._files, self._states, self._prompts = bench, files, states, prompts
        self._events, self._reserve_bytes = events, reserve_bytes
        self.jobs = jobs
        self.interlocks = Interlocks(bench, files, reserve_bytes)
        self.live: LiveDocument | None = None
        self.camera_lock = threading.Lock()
        self.turn = threading.RLock()
        self._look = {place: threading.Event() for place in PLACES}
        self.held: set[str] = set()
        self.controls: dict[str, JobControl] = {}
        self.running: dict[str, str | None] = dict.fromkeys(PLACES)
        self.turns = dict.fromkeys(PLACES, 0)
        self._ending = False
        self._threads = [
            threading.Thread(target=self._serve, args=(place,), name=place, daemon=True) for place in PLACES
        ]

    def start(self) -> None:
        """Begin to take jobs."""
        for thread in self._threads:
            thread.start()

    @property
    def recording(self) -> bool:
        """Whether frames are recorded now that must not be missed."""
        running = self.running["bench"]
        progress = None if running is None else self.jobs.get(running).progress
        return progress is not None and progress.unit == "frames" and progress.done < progress.total

    def wake(self) -> None:
        """Look whether a job can begin; waits for nobody."""
        for look in self._look.values():
            look.set()

    def threads(self) -> dict[str, threading.Thread]:
        """Its threads, by what they serve."""
        return {thread.name: thread for thread in self._threads}

    def close(self) -> None:
        """End what runs, as interrupted, and join."""
        with self.turn:
            self._ending = True
        self.wake()
        for control in list(self.controls.values()):
            control.abort("the daemon was stopped")
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(_JOIN_S)

    def require_possible(self, recipe: Recipe, *, homed: bool = False, first_step: int = 0) -> None:
        """Raise `InterlockError` with all that keeps a recipe from being done."""
        looked = self.interlocks.look(recipe, homed=homed, first_step=first_step)
        if not looked.ok:
            raise InterlockError(str(getattr(recipe, "recipe", "recipe")), looked.problems)

    def _serve(self, place: str) -> None:
        while not self._ending:
            taken = self._take(place)
            if taken is None:
                self._look[place].wait(_LOOK_S)
                self._look[place].clear()
                self.turns[place] += 1
                continue
            job, control = taken
            try:
                self._run(job, control)
            except Exception:
                _LOG.exception("a mistake in the program left a job without its end", job=job.id)
                self._look[place].wait(_LOOK_S)
            finally:
                self.controls.pop(job.id, None)
                self.running[place] = None

    def _take(self, place: str) -> tuple[JobDocument, JobControl] | None:
        with self.turn:
            job = None if self._ending else self._next(place)
            if job is None:
                return None
            job_id = job.id
            self.running[place] = job_id
            control = JobControl(lambda paused: self._paused(job_id, paused), self._at_rest)
            self.controls[job_id] = control
            return job, control

    def _next(self, place: str) -> JobDocument | None:
        if place == "bench" and self._states.state is not RigState.IDLE:
            return None
        for job in self.jobs.open():
            if job.place == place and job.status is JobStatus.QUEUED and job.id not in self.held:
                return job
        return None

    def _run(self, job: JobDocument, control: JobControl) -> None:
        with bind_job(job.id):
            with self.turn:
                if job.place == "bench" and not self._states.send_if_allowed("start", f"job {job.id}"):
                    return  # the state has changed since; it stays in line
                self.jobs.change(job.id, status=JobStatus.RUNNING, started_at=utc_now(), ended_at=None)
            _LOG.info("job begins", recipe=job.recipe.recipe, operator=job.operator)
            ending: dict[str, Any] = {"status": JobStatus.DONE}
            try:
                control.require_going("before it began", job.next_step or 0)
                self.require_possible(job.recipe, first_step=job.next_step or 0)
                if job.place == "bench":
                    with self.camera_lock:
                        self._do(job, control)
                else:
                    self._do(job, control)
            except Exception as error:
                ending = self._ended_by(error, job, control)
            with self.turn:
                ended = self.jobs.change(job.id, ended_at=utc_now(), prompt=None, **ending)
                self.controls.pop(job.id, None)
                self.running[job.place] = None
                self.live = None
            _LOG.info("job ended", status=ended.status.value, reason=ended.reason)
            if job.place == "bench":
                self._rig_after(ended)

    def _do(self, job: JobDocument, control: JobControl) -> None:
        def work_of(name: str, prefix: str) -> Work:
            reporting = Reporting(
                progress=lambda now, unit: self._progress(job.id, now, unit, prefix),
                warn=lambda text: self.jobs.warn(job.id, f"{prefix}{text}"),
                live=self._live,
            )
            return Work(name, self._bench, self._files, self._prompts, control, reporting, self._reserve_bytes)

        if isinstance(job.recipe, Campaign):
            state = CampaignState.of(job.next_step, dict(job.outputs), dict(job.figures))
            run_campaign(job.recipe, job.id, state, work_of, lambda now: self._keep(job.id, now))
            return
        work = work_of(f"{job.recipe.recipe}-{job.id}", "")
        work.first_step = job.next_step
        try:
            run_single(job.recipe, work)
        finally:
            self.jobs.change(job.id, outputs=dict(work.outputs), figures=cleaned(work.figures))

    def _keep(self, job_id: str, state: CampaignState) -> None:
        self.jobs.change(job_id, next_step=state.next_step, outputs=state.outputs(), figures=cleaned(state.figures))

    def _ended_by(self, error: Exception, job: JobDocument, control: JobControl) -> dict[str, Any]:
        told = str(error) or type(error).__name__
        step = {} if isinstance(job.recipe, Campaign) else _next_step(error)
        if self._ending:
            return {"status": JobStatus.INTERRUPTED, "reason": f"the daemon was stopped ({told})"} | step
        if control.aborted is not None:
            return {"status": JobStatus.ABORTED, "reason": f"{control.aborted} ({told})"} | step
        if isinstance(error, ProcedureStoppedError):
            return {"status": JobStatus.STOPPED, "reason": told} | step
        if not isinstance(error, BscdError | DeviceError | OSError | ValueError):
            _LOG.exception("a mistake in the program ended the job")
            told = f"a mistake in the program: {type(error).__name__}: {told}; see the log"
        return {"status": JobStatus.FAILED, "reason": told}

    def _rig_after(self, job: JobDocument) -> None:
        lost = [name for name, axis in self._bench.rig.axes.items() if not axis.status().connected] + [
            name for name, camera in self._bench.rig.cameras.items() if not camera.status().connected
        ]
        if lost:
            self._states.send_if_allowed("fail", f"{', '.join(lost)}: not connected any more; {job.reason}")
        self._states.send_if_allowed("finish", job.reason)

    def _paused(self, job_id: str, paused: bool) -> None:
        with self.turn:
            if paused and self._states.send_if_allowed("reached"):
                self.jobs.change(job_id, status=JobStatus.PAUSED)

    def _at_rest(self) -> None:
        self._bench.rig.stop_axes()
        with suppress(DeviceError):
            self._bench.vent()

    def _progress(self, job_id: str, now: Progress, unit: str, prefix: str) -> None:
        self.turns["bench"] += 1
        self.jobs.progress(job_id, now, unit, prefix)

    def _live(self, event: LiveEvent, document: LiveDocument | None) -> None:
        if document is not None:
            self.live = document
        told = live_event(event)
        if told is not None:
            self._events.publish("live", told)


def _next_step(error: Exception) -> dict[str, int]:
    step = getattr(error, "next_step", 0)
    return {"next_step": step} if step else {}
