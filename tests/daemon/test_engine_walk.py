"""Whatever people ask for, in any order: no state but by the table, no job lost, and the last word is the journal's."""

from __future__ import annotations

import tempfile
from contextlib import ExitStack, suppress
from pathlib import Path

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, initialize, invariant, rule

from bscd.daemon.documents import JobStatus, RigState
from bscd.daemon.errors import IllegalRequestError, InterlockError
from bscd.daemon.journal import Journal
from bscd.daemon.states import TRANSITIONS
from drivers.errors import NotConnectedError
from tests.daemon.small import recipe, small_daemon, until

REFUSED = (IllegalRequestError, InterlockError)


class Walk(RuleBasedStateMachine):
    """A daemon on the twin, in virtual time."""

    jobs = Bundle("jobs")

    @initialize()
    def open(self) -> None:
        self.ends = ExitStack()
        self.folder = Path(self.ends.enter_context(tempfile.TemporaryDirectory()))
        self.daemon = self.ends.enter_context(small_daemon(self.folder, sensor_px=320, attended=True))
        self.listener = self.ends.enter_context(self.daemon.events.subscribe(depth=100_000))
        self.asked: set[str] = set()
        self.state = self.daemon.states.state

    @rule(
        target=jobs,
        what=st.sampled_from(
            [
                {"kind": "home"},
                {"kind": "home", "again": True},
                {"kind": "move", "axis": "jacks", "position": 20.0},
                {"kind": "move", "axis": "rotation", "position": 90.0},
                {"kind": "move", "axis": "jacks", "position": 500.0},
                {"kind": "measure", "calibration": "a", "run": "b"},
                {"kind": "campaign", "steps": [{"name": "a", "do": {"recipe": "home"}}]},
                {"kind": "inflation", "inflation": {"rest_frames": 1, "ramp_s": 0.1, "hold_s": 0.1, "top_kpa": 1.0}},
            ]
        ),
    )
    def submit(self, what: dict) -> str:
        values = dict(what)
        try:
            job = self.daemon.submit(recipe(values.pop("kind"), **values), "walker")
        except REFUSED:
            return ""
        self.asked.add(job.id)
        return job.id

    @rule(job=jobs, what=st.sampled_from(["pause", "resume", "stop", "abort"]))
    def ask(self, job: str, what: str) -> None:
        if job:
            with suppress(*REFUSED):
                order = ("why",) if what == "abort" else ()
                getattr(self.daemon, f"{what}_job")(job, "walker", *order)

    @rule(job=consumes(jobs))
    def again(self, job: str) -> None:
        if job:
            with suppress(*REFUSED):
                self.daemon.resume_from(job, "walker")

    @rule(what=st.sampled_from(["connect", "disconnect", "reset_estop"]))
    def rig(self, what: str) -> None:
        with suppress(IllegalRequestError):
            getattr(self.daemon, what)("walker")

    @rule()
    def estop(self) -> None:
        self.daemon.estop.trigger("walker")
        assert self.daemon.states.state is RigState.ESTOPPED

    @rule()
    def let_it_work(self) -> None:
        until(lambda: not self._works(), "rest")

    @invariant()
    def only_by_the_table(self) -> None:
        if not hasattr(self, "daemon"):
            return
        while (event := self.listener.get(0.0)) is not None:
            if event.kind == "state":
                before, after = RigState(event.data["before"]), RigState(event.data["state"])
                assert before is self.state
                assert any(before in sources and after is target for sources, target in TRANSITIONS.values())
                self.state = after

    @invariant()
    def no_job_is_lost(self) -> None:
        if hasattr(self, "daemon"):
            assert {job.id for job in self.daemon.jobs(limit=1000)} == self.asked

    def teardown(self) -> None:
        if not hasattr(self, "daemon"):
            return
        with self.ends:
            self._ends_well()

    def _ends_well(self) -> None:
        self.daemon.estop.trigger("walker")
        until(lambda: not self._works(), "the last job's end")
        assert not any(axis.status().moving for axis in self.daemon.bench.rig.axes.values())
        with suppress(NotConnectedError):  # they may have disconnected it
            assert self.daemon.bench.rig.pressure.set_point_kpa() == 0.0
        self.daemon.close()
        journal = Journal(self.folder / "data/journal.sqlite")
        kept = journal.jobs(limit=1000)
        journal.close()
        assert {job.id for job in kept} == self.asked
        assert all(job.status.ended or job.status is JobStatus.QUEUED for job in kept)

    def _works(self) -> bool:
        """Something is done, or will be without anybody asking."""
        shop = self.daemon.engine.shop
        if any(shop.running.values()):
            paused = self.daemon.states.state is RigState.PAUSED
            return not (paused and shop.running["desk"] is None)
        waiting = [job for job in self.daemon.engine.jobs.open() if job.id not in shop.held]
        return bool(waiting) and (
            self.daemon.states.state is RigState.IDLE or any(job.place == "desk" for job in waiting)
        )


TestWalk = Walk.TestCase
TestWalk.settings = settings(
    max_examples=25, stateful_step_count=25, deadline=None, suppress_health_check=list(HealthCheck)
)
