"""After a crash: run files that were being written are made readable, and jobs know where they can go on."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import structlog

from bscd import acquisition, procedures
from bscd.daemon.documents import JobDocument
from bscd.daemon.files import DataFolder
from bscd.daemon.journal import Journal
from bscd.daemon.recipes import BscScan, ReferenceScan
from bscd.errors import BscdError

_LOG = structlog.get_logger(__name__)


def recover_runs(files: DataFolder, interrupted: Iterable[JobDocument], journal: Journal) -> None:
    """Recover the runs of interrupted jobs in their place; raw data is never rewritten.

    A run that can not be recovered stays as it is, with the reason among its job's warnings.
    """
    for job in interrupted:
        runs = sorted(files.folder("run").glob(f"*{job.id}*.h5"))
        told = [_recovered(path) for path in runs]
        changes: dict[str, object] = {"warnings": (*job.warnings, *(text for text in told if text))}
        if isinstance(job.recipe, ReferenceScan | BscScan) and runs:
            changes |= {"next_step": _next_step(runs[0], job.next_step), "outputs": {"run": runs[0].stem}}
        journal.save(job.model_copy(update=changes))


def _recovered(path: Path) -> str:
    try:
        done = acquisition.recover_in_place(path)
    except (BscdError, OSError) as error:
        _LOG.warning("a run could not be recovered", run=path.name, error=str(error))
        return f"{path.stem}: not recovered: {error}"
    if done.damage:
        return f"{path.stem}: {done.frames} frames are there, {done.damage}"
    return f"{path.stem}: its {done.frames} frames were recovered" if done.changed else ""


def _next_step(path: Path, known: int | None) -> int | None:
    try:
        return procedures.recorded_steps(path)[0]
    except BscdError:
        return known
