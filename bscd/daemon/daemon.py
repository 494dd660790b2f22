"""The daemon: owns the rig, its data folder and its journal; everything that API and page can do is here."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import structlog

from bscd.config import RigConfig, parse_config
from bscd.daemon.bench import Bench
from bscd.daemon.documents import (
    DeviceDocument,
    EStopDocument,
    JobDocument,
    JobStatus,
    RigState,
    StatusDocument,
    ValidationDocument,
)
from bscd.daemon.engine import Engine
from bscd.daemon.errors import IllegalRequestError
from bscd.daemon.estop import EmergencyStop
from bscd.daemon.events import EventLog
from bscd.daemon.files import DataFolder
from bscd.daemon.jobs import utc_now
from bscd.daemon.journal import Journal, JournalError
from bscd.daemon.keys import KeyStore
from bscd.daemon.latest import LatestFrames
from bscd.daemon.lease import ControlLease
from bscd.daemon.poller import Poller
from bscd.daemon.prompts import Prompts
from bscd.daemon.recipes import AnyRecipe
from bscd.daemon.recovering import RunCheck, recover_runs
from bscd.daemon.states import RigStates
from bscd.errors import BscdError, InputError
from bscd.procedures import Rig, RigNotReadyError
from bscd.version import __version__
from drivers.clock import Clock, HostClock
from drivers.errors import DeviceError

_LOG = structlog.get_logger(__name__)

JOURNAL = "journal.sqlite"

#: While somebody looks at an idle camera it takes a picture so often at most.
_VIEW_S = 0.5


class Daemon:
    """One rig. Made offline and with the journal reconciled; `connect` connects it. All of it from any thread.

    Parameters
    ----------
    config, config_text
        The rig, and the text that it was read from; ``folder`` is where a relative data folder begins.
    emulate
        Put the twin behind its wire protocols and drive it with the real drivers.
    attended
        Whether there is an operator to confirm what recipes ask; None: wherever the rig is no twin.
    """

    def __init__(
        self,
        config: RigConfig,
        config_text: str,
        folder: Path,
        *,
        clock: Clock | None = None,
        emulate: bool = False,
        attended: bool | None = None,
    ) -> None:
        self.config, self.config_text, self.settings = config, config_text, config.daemon
        clock = clock or HostClock()
        self.files = DataFolder(folder / config.daemon.data_folder)
        self.keys = KeyStore(self.files.root / config.daemon.keys_file)
        self.lease = ControlLease(config.daemon.lease_s)
        self.latest = LatestFrames()
        self.events = EventLog()
        self.journal = Journal(self.files.root / JOURNAL)
        self.states = RigStates(self._state_changed)
        unattended = config.twin is not None if attended is None else not attended
        self._prompts = Prompts(
            clock, config.daemon.confirm_timeout_s, self._prompt_changed, self._told, unattended=unattended
        )
        self._engine: Engine | None = None
        self._rig_lock = threading.Lock()
        self._viewed_s = 0.0
        try:
            self.bench = Bench(config, config_text, clock, self.latest, self._prompts, emulate=emulate)
        except BaseException:
            self.journal.close()
            raise
        self.estop = EmergencyStop(self.bench.latch, self.bench.stop_commands, self._estopped)
        self.interrupted = self.journal.reconcile("the daemon ended under it")
        to_check = recover_runs(self.files, self.interrupted, self.journal)
        self.run_check = RunCheck(to_check, lambda job_id, text: self.engine.jobs.warn_later(job_id, text))
        self._engine = Engine(
            self.bench,
            self.files,
            self.journal,
            self.events,
            self.states,
            self._prompts,
            reserve_bytes=round(config.daemon.reserve_mb * 1e6),
            queue_limit=config.daemon.queue_limit,
            being_checked=lambda: self.run_check.jobs,
        )
        self.run_check.start()
        self.poller = Poller(self.bench, self.events, config.daemon.poll_s, self._lost, self._view_if_idle)
        self.poller.start()

    @property
    def engine(self) -> Engine:
        """What runs jobs."""
        if self._engine is None:
            raise BscdError("the daemon is not ready yet")
        return self._engine

    # the rig

    def connect(self, by: str) -> None:
        """Connect every device and vent; nothing moves.

        Raises `RigNotReadyError` with all that did not answer (the others are connected, and vented all the same).
        """
        with self._rig_lock:
            self.states.send("connect", f"asked by {by}")
            self._connected()

    def disconnect(self, by: str) -> None:
        """Release every device; the pressure is vented."""
        with self._rig_lock:
            self.states.send("disconnect", f"asked by {by}")
            with self.engine.shop.camera_lock:
                self.bench.rig.close()
            self.poller.look()

    def reset_estop(self, by: str) -> None:
        """Let things move again; nothing does by itself."""
        with self._rig_lock:
            triggers = self.estop.triggers()
            if triggers is None:
                raise IllegalRequestError("an e-stop is under way", self.states.state.value, self.states.allowed)
            self.states.send("reset", f"e-stop reset by {by}")
            if not self.estop.reset(triggers):
                self.states.send("estop", f"by {self.estop.document().by}")
                raise IllegalRequestError("it was triggered again", self.states.state.value, self.states.allowed)
            self.events.publish("estop", self.estop.document().model_dump(mode="json"))
            self._connected()

    def _connected(self) -> None:
        """Connect all that answers, and vent whatever else fails."""
        rig: Rig = self.bench.rig
        failures: dict[str, DeviceError] = {}
        by_hand = ""
        try:
            rig.connect()
        except RigNotReadyError as error:
            failures = error.failures
        try:
            self.bench.vent()
        except DeviceError as error:
            failures = {"pressure": error} | failures
            by_hand = "; the pressure could not be let out, open the valve by hand"
        if failures:
            failed = RigNotReadyError("connecting", failures, len(rig.devices))
            self.states.send_if_allowed("fail", f"{failed}{by_hand}")
            self.poller.look()
            raise failed
        self.poller.look()
        self.states.send_if_allowed("connected", "connected, vented; nothing moved")

    # what is asked

    def status(self) -> StatusDocument:
        """Everything at a glance, from what is known; waits for no device."""
        engine = self.engine
        return StatusDocument(
            revision=self.events.last_id,
            time=utc_now(),
            version=__version__,
            rig=self.config.rig.name,
            state=self.states.state,
            allowed=self.states.allowed,
            reason=self.states.reason,
            job=engine.current,
            queue=tuple(engine.waiting()),
            desk=tuple(engine.at_the_desk()),
            devices=self.poller.documents,
            estop=self.estop.document(),
            lease=self.lease.document(),
            live=engine.shop.live,
            disk_free_bytes=shutil.disk_usage(self.files.root).free,
            pressure_kpa=self.poller.pressure_kpa,
        )

    def devices(self) -> dict[str, DeviceDocument]:
        """The devices as they were last seen."""
        return self.poller.documents

    def validate(self, recipe: AnyRecipe) -> ValidationDocument:
        """What a recipe would take, and what keeps it from starting; moves nothing."""
        return self.engine.shop.interlocks.look(recipe)

    def submit(self, recipe: AnyRecipe, by: str, idempotency_key: str | None = None) -> JobDocument:
        """See `Engine.submit`."""
        return self.engine.submit(recipe, by, idempotency_key=idempotency_key)

    def job(self, job_id: str) -> JobDocument:
        """Raises `UnknownNameError`."""
        return self.engine.jobs.get(job_id)

    def jobs(self, status: JobStatus | None = None, limit: int = 100, before: str | None = None) -> list[JobDocument]:
        """The newest jobs first."""
        now = {job.id: job for job in self.engine.jobs.open()}
        return [now.get(job.id, job) for job in self.journal.jobs(status, limit, before)]

    def pause_job(self, job_id: str, by: str) -> JobDocument:
        """See `Engine.pause`."""
        return self.engine.pause(job_id)

    def resume_job(self, job_id: str, by: str) -> JobDocument:
        """See `Engine.resume`."""
        return self.engine.resume(job_id)

    def stop_job(self, job_id: str, by: str) -> JobDocument:
        """See `Engine.stop`."""
        return self.engine.stop(job_id)

    def abort_job(self, job_id: str, by: str, reason: str) -> JobDocument:
        """See `Engine.abort`."""
        return self.engine.abort(job_id, f"aborted by {by}: {reason}" if reason else f"aborted by {by}")

    def resume_from(self, job_id: str, by: str, step: int | None = None) -> JobDocument:
        """See `Engine.resume_from`."""
        return self.engine.resume_from(job_id, step)

    def confirm(self, job_id: str, prompt: int, by: str, value: float | None = None) -> JobDocument:
        """See `Engine.confirm`."""
        return self.engine.confirm(job_id, prompt, value)

    def ready(self) -> tuple[bool, str]:
        """Whether the rig can take a job, and why not."""
        state = self.states.state
        well = state not in (RigState.OFFLINE, RigState.CONNECTING, RigState.FAULT, RigState.ESTOPPED)
        return well, "" if well else f"{state.value}: {self.states.reason}"

    def live(self) -> tuple[bool, str]:
        """Whether the daemon's own threads go on; a rig at fault is none of theirs."""
        dead = [name for name, thread in self.engine.shop.threads().items() if not thread.is_alive()]
        return not dead, f"{', '.join(dead)}: ended" if dead else ""

    def progress(self) -> dict[str, Callable[[], int]]:
        """Counters of the daemon's parts, each of which grows while that part is well.

        While frames come the procedure must look after them and the recorder take them; another job may wait for an
        axis as long as that takes, while its devices answer.
        """
        shop, poller = self.engine.shop, self.poller

        def bench() -> int:
            waits = shop.running["bench"] and not shop.watch.streaming
            return shop.turns["bench"] + shop.looks() + (poller.turns if waits else 0)

        def recorder() -> int:
            return shop.watch.progress(poller.turns)

        def desk() -> int:
            return shop.turns["desk"] + (poller.turns if shop.running["desk"] else 0)

        return {"engine": bench, "recorder": recorder, "desk": desk, "poller": lambda: poller.turns}

    def close(self) -> None:
        """End jobs as interrupted, vent, release every device, close the journal."""
        self.poller.close()
        self.run_check.close()
        if self._engine is not None:
            self._engine.close()
        self.estop.close()
        self.bench.close()
        self.journal.close()

    # what happens

    def _state_changed(self, before: RigState, after: RigState, reason: str) -> None:
        _LOG.info("state", before=before.value, after=after.value, reason=reason)
        told = {"before": before.value, "state": after.value, "reason": reason, "allowed": self.states.allowed}
        self.events.publish("state", told)
        if self._engine is not None:
            self._engine.wake()

    def _prompt_changed(self) -> None:
        self.engine.prompt_changed()

    def _told(self, text: str) -> None:
        self.events.publish("warning", {"text": text})

    def _estopped(self, document: EStopDocument) -> None:
        self.states.send("estop", f"by {document.by}")
        self.events.publish("estop", document.model_dump(mode="json"))
        _LOG.warning("e-stop", by=document.by, took_ms=document.took_ms, failures=list(document.failures))
        if self._engine is not None:
            self._engine.abort_bench(f"e-stop by {document.by}")
        with suppress(JournalError):
            self.journal.audit(document.by, "e-stop", "every axis, pressure", "latched", "; ".join(document.failures))

    def _lost(self, names: tuple[str, ...]) -> None:
        if self.states.state is RigState.IDLE:
            problems = [self.poller.documents[name].problem or "it does not answer" for name in names]
            told = "; ".join(f"{name}: {problem}" for name, problem in zip(names, problems, strict=True))
            self.states.send_if_allowed("fail", told)

    def _view_if_idle(self) -> None:
        """A picture of each camera that somebody looks at, while nothing else uses them."""
        now_s = time.monotonic()
        if self.states.state is not RigState.IDLE or now_s - self._viewed_s < _VIEW_S:
            return
        self._viewed_s = now_s
        if not self.engine.shop.camera_lock.acquire(blocking=False):
            return
        try:
            for camera in self.bench.rig.cameras.values():
                if self.latest.wanted(camera.name):
                    camera.snap()
        except DeviceError as error:
            _LOG.info("no live picture", error=str(error))
        finally:
            self.engine.shop.camera_lock.release()

    def __enter__(self) -> Self:
        """The daemon."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()


def open_daemon(
    path: Path, *, emulate: bool = False, attended: bool | None = None, clock: Clock | None = None, **changes: Any
) -> Daemon:
    """The daemon of a configuration file, with ``changes`` to its [daemon] section.

    Raises `InputError` for one that is wrong.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: can not be read ({error.strerror}); name a configuration") from error
    config = parse_config(text, str(path))
    config = config.model_copy(update={"daemon": config.daemon.model_copy(update=changes)})
    return Daemon(config, text, path.absolute().parent, clock=clock, emulate=emulate, attended=attended)


__all__ = ["JOURNAL", "Daemon", "RigNotReadyError", "open_daemon"]
