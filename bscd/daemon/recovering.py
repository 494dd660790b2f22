"""After a crash: run files that were being written are made readable, and jobs know where they can go on."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import structlog

from bscd import acquisition, procedures
from bscd.daemon.documents import JobDocument
from bscd.daemon.errors import UnknownNameError
from bscd.daemon.files import DataFolder
from bscd.daemon.journal import Journal
from bscd.daemon.recipes import BscScan, ReferenceScan
from bscd.errors import BscdError

_LOG = structlog.get_logger(__name__)
_JOIN_S = 60.0

#: A job's id in the name of a run that it made.
_JOB = re.compile(r"\d{8}-\d{6}-[0-9a-f]{4}")


def recover_runs(files: DataFolder, interrupted: Iterable[JobDocument], journal: Journal) -> dict[Path, str]:
    """Recover the runs of interrupted jobs in their place; raw data is never rewritten.

    Also those that an earlier start did not come to. A run that can not be recovered stays as it is, with the reason
    among its job's warnings. Returns the runs to be checked, each with its job's id: reading all of one takes long, and
    the membrane has to be vented first.
    """
    runs: dict[str, list[Path]] = {job.id: [] for job in interrupted}
    for path in sorted(files.folder("run").glob("*.h5")):
        found = _JOB.search(path.stem)
        if found is not None and (found[0] in runs or _left_open(path)):
            runs.setdefault(found[0], []).append(path)
    to_check: dict[Path, str] = {}
    for job_id, paths in runs.items():
        try:
            job = journal.job(job_id)
        except UnknownNameError:  # the journal was lost, or is another daemon's
            continue
        told = []
        for path in paths:
            text, whole = _recovered(path)
            told += [text] if text else []
            if whole:
                to_check[path] = job_id
        changes: dict[str, object] = {"warnings": (*job.warnings, *told)}
        if isinstance(job.recipe, ReferenceScan | BscScan) and paths:
            changes |= {"next_step": _next_step(paths[0], job.next_step), "outputs": {"run": paths[0].stem}}
        journal.save(job.model_copy(update=changes))
    return to_check


class RunCheck:
    """Reads recovered runs through on a thread of its own; ``damaged(job, text)`` is told what is not as recorded."""

    def __init__(self, runs: Mapping[Path, str], damaged: Callable[[str, str], None]) -> None:
        self._left, self._damaged = dict(runs), damaged
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="run check", daemon=True)

    @property
    def jobs(self) -> set[str]:
        """Jobs whose runs are still to be read through."""
        return set(self._left.values())

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self) -> None:
        """End it after the frame that is being read, and join."""
        self._ending.set()
        if self._thread.ident is not None:
            self._thread.join(_JOIN_S)

    def _run(self) -> None:
        for path, job_id in list(self._left.items()):
            try:
                with acquisition.RunFile(path) as run:
                    damage = run.verify(self._ending.is_set)
            except (BscdError, OSError) as error:
                damage = str(error)
            if self._ending.is_set():
                return
            self._left.pop(path)
            if damage:
                _LOG.warning("a recovered run is damaged", run=path.name, damage=damage)
                self._damaged(job_id, f"{path.stem}: {damage}")


def _left_open(path: Path) -> bool:
    try:
        return acquisition.is_unfinished(path)
    except (BscdError, OSError):
        return False  # no run file, which whoever opens it is told


def _recovered(path: Path) -> tuple[str, bool]:
    try:
        done = acquisition.recover_in_place(path, verify=False)
    except (BscdError, OSError) as error:
        _LOG.warning("a run could not be recovered", run=path.name, error=str(error))
        return f"{path.stem}: not recovered: {error}", False
    return (f"{path.stem}: its {done.frames} frames were recovered" if done.changed else ""), True


def _next_step(path: Path, known: int | None) -> int | None:
    try:
        return procedures.recorded_steps(path)[0]
    except BscdError:
        return known
