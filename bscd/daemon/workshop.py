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
from bscd.daemon.running.recording_watch import RecordingWatch
from bscd.daemon.running.work import Reporting, Work
from bscd.daemon.states import RigStates
from bscd.errors import BscdError
from bscd.procedures import ProcedureStoppedError, Progress
from bscd.procedures.live.messages import LiveEvent
from bscd.procedures.recording.ending import NotVentedError
from drivers.errors import DeviceError, MoveStoppedError

_LOG = structlog.get_logger(__name__)
_JOIN_S = 60.0

#: The line is looked at so often, also when nothing was told of it.
_LOOK_S = 1.0

#: The e-stop's longest time to its word, with the time that it gives the slowest device.
_ESTOP_TELLS_S = 2.0

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
        self.watch = RecordingWatch()
        self._ending = False
        self._threads = [
            threading.Thread(target=self._serve, args=(place,), name=place, daemon=True) for place in PLACES
        ]

    def start(self) -> None:
        """Begin to take jobs."""
        for thread in self._threads:
            thread.start()

    def looks(self) -> int:
        """How often the bench's job has looked whether it is to stop."""
        control = self.controls.get(self.running["bench"] or "")
        return 0 if control is None else control.stop_only.looks

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
            at_once = self._at_rest if place == "bench" else _nothing  # the desk moves nothing
            control = JobControl(lambda paused: self._paused(job_id, paused), at_once)
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
                    self._put_back(job, control)
                    return
                self.jobs.change(job.id, status=JobStatus.RUNNING, started_at=utc_now(), ended_at=None)
            _LOG.info("job begins", recipe=job.recipe.recipe, operator=job.operator)
            ending: dict[str, Any] = {"status": JobStatus.DONE}
            unsafe = False
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
                unsafe = isinstance(error, NotVentedError)
            with self.turn:
                ended = self.jobs.change(job.id, ended_at=utc_now(), prompt=None, **ending)
                self.controls.pop(job.id, None)
                self.running[job.place] = None
                self.live = None
            _LOG.info("job ended", status=ended.status.value, reason=ended.reason)
            if job.place == "bench":
                self._rig_after(ended, unsafe)

    def _do(self, job: JobDocument, control: JobControl) -> None:
        def work_of(name: str, prefix: str) -> Work:
            self.jobs.begin_stretch(job.id)
            reporting = Reporting(
                progress=lambda now, unit: self._progress(job, now, unit, prefix),
                warn=lambda text: self.jobs.warn(job.id, f"{prefix}{text}"),
                live=self._live,
            )
            return Work(
                name, self._bench, self._files, self._prompts, control, reporting, self._reserve_bytes, self.watch
            )

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
        if self._bench.latch.closed:  # the e-stop stops axes first, and says who it was when that is done
            control.wait_aborted(_ESTOP_TELLS_S)
        step = {} if isinstance(job.recipe, Campaign) else _next_step(error)
        if self._ending:
            return {"status": JobStatus.INTERRUPTED, "reason": f"the daemon was stopped ({told})"} | step
        if control.aborted is not None:
            return {"status": JobStatus.ABORTED, "reason": f"{control.aborted} ({told})"} | step
        if isinstance(error, ProcedureStoppedError) or (control.stopping and isinstance(error, MoveStoppedError)):
            return {"status": JobStatus.STOPPED, "reason": told} | step
        if not isinstance(error, BscdError | DeviceError | OSError | ValueError):
            _LOG.exception("a mistake in the program ended the job")
            told = f"a mistake in the program: {type(error).__name__}: {told}; see the log"
        return {"status": JobStatus.FAILED, "reason": told}

    def _put_back(self, job: JobDocument, control: JobControl) -> None:
        """The state has changed since it was taken: it stays in line, unless it was asked to end meanwhile."""
        if not control.stopping:
            return
        status = JobStatus.STOPPED if control.aborted is None else JobStatus.ABORTED
        self.jobs.change(job.id, status=status, reason=control.aborted or "stopped before it began", ended_at=utc_now())

    def _rig_after(self, job: JobDocument, unsafe: bool) -> None:
        lost = self._bench.lost()
        if lost or unsafe:
            gone = f"{', '.join(lost)}: not connected any more; " if lost else ""
            self._states.send_if_allowed("fail", f"{gone}{job.reason}")
        self._states.send_if_allowed("finish", job.reason)

    def _paused(self, job_id: str, paused: bool) -> None:
        with self.turn:
            if paused and self._states.send_if_allowed("reached"):
                self.jobs.change(job_id, status=JobStatus.PAUSED)

    def _at_rest(self) -> None:
        self._bench.rig.stop_axes()
        with suppress(DeviceError):
            self._bench.vent()

    def _progress(self, job: JobDocument, now: Progress, unit: str, prefix: str) -> None:
        self.turns[job.place] += 1
        self.jobs.progress(job.id, now, unit, prefix)

    def _live(self, event: LiveEvent, document: LiveDocument | None) -> None:
        if document is not None:
            self.live = document
        told = live_event(event)
        if told is not None:
            self._events.publish("live", told)


def _nothing() -> None:
    pass


def _next_step(error: Exception) -> dict[str, int]:
    step = getattr(error, "next_step", 0)
    return {"next_step": step} if step else {}
