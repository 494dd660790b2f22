"""Scan the target through the measurement volume, with or without the biprism (paper, section 2.2)."""

from __future__ import annotations

import shutil
import threading
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from bscd.acquisition import CameraMeta, FrameRecord, RunFile, RunWriter
from bscd.calibration.target import GridTarget
from bscd.errors import CheckFailedError, InputError
from bscd.procedures.progress import Progress, ProgressCallback, require_going
from bscd.procedures.recipes import ScanRecipe, ScanStep
from bscd.procedures.rehearsal import dry_run, prism_height_mm
from bscd.procedures.rig import CameraRole, Rig
from bscd.procedures.step_check import StepCheck
from bscd.procedures.taking import axes_of, send, whole_frame


@dataclass(frozen=True)
class ScanResult:
    """A finished scan: its file, the steps done by this call, and how long they took (s, the rig's clock)."""

    path: Path
    first_step: int
    steps: int
    frames: int
    duration_s: float


def record_scan(
    rig: Rig,
    recipe: ScanRecipe,
    target: GridTarget,
    path: str | Path,
    *,
    title: str = "",
    config_text: str = "",
    progress: ProgressCallback | None = None,
    stop: threading.Event | None = None,
) -> ScanResult:
    """Scan into a new run file.

    Before anything moves the recipe is checked against the rig (`dry_run`). Every position's frames are checked
    before they are stored. However it ends, the axes are at rest; a file that was begun is readable and, after
    a stop or a failure, `resume_scan` goes on with it.

    Raises
    ------
    InputError
        The recipe does not fit the rig, or the file exists; nothing moved.
    CheckFailedError
        An image did not pass; it was not stored. The message names the step to go on from.
    ProcedureStoppedError
        ``stop`` was set; checked between steps.
    drivers.errors.DeviceError
        A device failed.
    """
    path = Path(path)
    dry_run(rig, recipe, free_bytes=shutil.disk_usage(path.absolute().parent).free).require_ok()
    cameras: dict[CameraRole, CameraMeta] = {
        role: CameraMeta.from_info(rig.cameras[role].info()) for role in recipe.camera_roles
    }
    writer = RunWriter(
        path,
        title=title or f"{recipe.kind} scan of {recipe.positions} positions",
        cameras=cameras,
        config_text=config_text,
        recipe_text=recipe.model_dump_json(),
        axes=axes_of(rig),
    )
    return _scan(rig, recipe, target, writer, 0, progress, stop)


def resume_scan(
    rig: Rig,
    target: GridTarget,
    path: str | Path,
    *,
    first_step: int | None = None,
    progress: ProgressCallback | None = None,
    stop: threading.Event | None = None,
) -> ScanResult:
    """Go on with an interrupted scan, by the recipe in its file, from ``first_step`` (by default the next one).

    Frames that were recorded stay as they are. Raises as `record_scan`.
    """
    with RunFile(path) as run:
        recipe = _stored_recipe(run)
    recorded, total = recorded_steps(path)
    writer = RunWriter.reopen(path)
    try:
        first = recorded if first_step is None else first_step
        if first == total and first_step is None:
            raise InputError(f"{path}: all {total} steps of the scan are recorded; there is nothing to go on with")
        if first > recorded:
            raise InputError(f"{path}: steps 0 to {recorded - 1} are recorded; going on from {first} would leave a gap")
        free_bytes = shutil.disk_usage(Path(path).absolute().parent).free
        dry_run(rig, recipe, start=first, free_bytes=free_bytes).require_ok()
    except BaseException as error:
        writer.interrupt(str(error) or type(error).__name__)
        raise
    return _scan(rig, recipe, target, writer, first, progress, stop)


def recorded_steps(path: str | Path) -> tuple[int, int]:
    """How many steps of a scan's file are recorded, from the first on, and of how many.

    Raises `InputError` for a file that holds no scan.
    """
    with RunFile(path) as run:
        recipe = _stored_recipe(run)
        return _recorded_steps(run, recipe), len(recipe.steps())


def _scan(
    rig: Rig,
    recipe: ScanRecipe,
    target: GridTarget,
    writer: RunWriter,
    first_step: int,
    progress: ProgressCallback | None,
    stop: threading.Event | None,
) -> ScanResult:
    steps = recipe.steps()
    full_scale: dict[CameraRole, float] = {
        name: float(2**meta.bit_depth - 1) for name, meta in writer.header.cameras.items()
    }
    check = StepCheck(recipe, target, full_scale)
    begun_s = rig.clock.now_s()
    before = writer.frames_written
    report = progress or (lambda _: None)
    try:
        with writer:
            require_going(stop, f"scan: before step {first_step}", first_step)
            _configure(rig, recipe)
            height_mm = prism_height_mm(rig, recipe)
            report(Progress(first_step, len(steps), f"moving the biprism to {height_mm:g} mm"))
            send(rig.jacks, height_mm, writer, "jack")
            for number in range(first_step, len(steps)):
                step = steps[number]
                require_going(stop, f"scan: before step {number} ({step})", number)
                report(Progress(number, len(steps), str(step)))
                _go(rig, step, recipe, writer)
                records = _expose(rig, step, recipe)
                try:
                    check(step, records)
                except CheckFailedError as error:
                    raise CheckFailedError(f"{error} (scan stopped at step {number} of {len(steps)})") from error
                for record in records:
                    writer.append(record)
            frames = writer.frames_written - before
    finally:
        rig.stop_axes()
    report(Progress(len(steps), len(steps), "done"))
    return ScanResult(writer.path, first_step, len(steps) - first_step, frames, rig.clock.now_s() - begun_s)


def _configure(rig: Rig, recipe: ScanRecipe) -> None:
    if recipe.exposure_s is None and recipe.gain_db is None:
        return
    for role in recipe.camera_roles:
        rig.cameras[role].configure(exposure_s=recipe.exposure_s, gain_db=recipe.gain_db)


def _go(rig: Rig, step: ScanStep, recipe: ScanRecipe, writer: RunWriter) -> None:
    send(rig.rotation, step.rotation_deg, writer, "rotation")
    send(rig.translation, rig.origin_mm + step.y_mm, writer, "translation")
    rig.clock.sleep(recipe.settle_s)


def _expose(rig: Rig, step: ScanStep, recipe: ScanRecipe) -> list[FrameRecord]:
    """The frames of all cameras at one position, each with the axes' readings."""
    y_mm = rig.translation.status().position - rig.origin_mm
    rotation_deg, jack_mm = rig.rotation.status().position, rig.jacks.status().position
    records = []
    for role in recipe.camera_roles:
        status = rig.cameras[role].status()
        for _ in range(recipe.frames_per_position):
            frame = whole_frame(rig, role, status.exposure_s)
            records.append(
                FrameRecord(
                    camera=role,
                    phase=step.phase,
                    data=frame.data,
                    frame_id=frame.frame_id,
                    camera_time_ns=frame.camera_time_ns,
                    host_time_ns=frame.host_time_ns,
                    target_position=step.position,
                    y_mm=y_mm,
                    rotation_deg=rotation_deg,
                    jack_mm=jack_mm,
                    exposure_s=status.exposure_s,
                    gain_db=status.gain_db,
                )
            )
    return records


def _stored_recipe(run: RunFile) -> ScanRecipe:
    try:
        return ScanRecipe.model_validate_json(run.recipe_text)
    except ValidationError as err:
        raise InputError(f"{run.path}: it holds no scan recipe; only a scan can go on") from err


def _recorded_steps(run: RunFile, recipe: ScanRecipe) -> int:
    """How many steps from the first on have all frames of all cameras."""
    counts = Counter((str(row["camera"]), str(row["phase"]), int(row["target_position"])) for row in run.table())
    steps = recipe.steps()
    for number, step in enumerate(steps):
        seen = [counts[role, step.phase, step.position] for role in recipe.camera_roles]
        if min(seen) < recipe.frames_per_position:
            return number
    return len(steps)
