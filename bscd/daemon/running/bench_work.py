"""Recipes that need the rig, each as the procedure that does it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from bscd.acquisition import RunFile, RunState
from bscd.calibration import Calibration
from bscd.daemon.documents import LiveDocument
from bscd.daemon.recipes import Align, BscScan, Home, Inflation, Move, ReferenceScan, SphereCheck
from bscd.daemon.running.desk import do_at_the_desk
from bscd.daemon.running.tasks import MeasureTask
from bscd.daemon.running.work import Work, scan_defaults
from bscd.errors import CheckFailedError
from bscd.procedures import (
    Progress,
    align_biprism,
    align_cameras,
    home,
    record_scan,
    recorded_steps,
    resume_scan,
)
from bscd.procedures.live import LiveCatchingUp, LiveEvent, LiveFailure, LiveFrame, LiveWarning, record_and_measure
from bscd.procedures.measuring import MeasureSettings
from bscd.procedures.recording import Recording, Storing, record_inflation, record_sphere


def run_home(recipe: Home, work: Work) -> None:
    """Home; its figures are the readings afterwards."""
    count = len(work.bench.rig.axes)
    report, begun = work.progress("axes"), 0

    def progress(doing: str) -> None:
        nonlocal begun
        report(Progress(begun, count, doing))
        begun += 1

    done = home(work.bench.rig, again=recipe.again, progress=progress, stop=work.control.pausable)
    for role, homed in done.items():
        work.figures[f"{role}_{homed.unit}"] = homed.position
    report(Progress(count, count, "done"))


def run_move(recipe: Move, work: Work) -> None:
    """Move one axis; its figure is the reading afterwards."""
    axis = work.bench.rig.axes[recipe.axis]
    unit = axis.info().unit
    work.progress("moves")(Progress(0, 1, f"{recipe.axis} to {recipe.position:g} {unit}"))
    try:
        axis.move_to(recipe.position)
    finally:
        axis.stop()
    work.figures[f"{recipe.axis}_{unit}"] = axis.status().position
    work.progress("moves")(Progress(1, 1, "done"))


def run_align(recipe: Align, work: Work) -> None:
    """Bring the cube to its place and say what to turn; not being aligned is a warning, never a failure."""
    rig, scan = work.bench.rig, work.bench.config.scan
    target = work.bench.config.target.grid()
    angle_deg = scan.corner_rotation_deg if recipe.pose == "corner" else scan.face_rotation_deg
    work.progress("views")(Progress(0, 1, f"{recipe.pose} pose at POS.0"))
    rig.primary.configure(exposure_s=scan.exposure_s, gain_db=scan.gain_db)
    if rig.auxiliary is not None:
        rig.auxiliary.configure(exposure_s=scan.exposure_s, gain_db=scan.gain_db)
    try:
        rig.rotation.move_to(angle_deg)
        rig.translation.move_to(rig.origin_mm)
    finally:
        rig.stop_axes()
    work.control.require_going("alignment: before the picture")
    looked = align_biprism if recipe.view == "biprism" else align_cameras
    report = looked(rig, target, pose=recipe.pose, frames=recipe.frames)
    for item in report.items:
        work.figures[f"{item.name} ({item.unit})" if item.unit else item.name] = item.value
        if not item.ok:
            work.reporting.warn(f"alignment: {item.name} is {item.value:.3g} {item.unit}: {item.advice}")
    work.figures["aligned"] = report.ok
    work.progress("views")(Progress(1, 1, "done"))


def run_scan(recipe: ReferenceScan | BscScan, work: Work) -> None:
    """Scan, or go on with the scan that was begun under this name."""
    bench = work.bench
    target = bench.config.target.grid()
    how: dict[str, Any] = {"progress": work.progress("positions"), "stop": work.control.pausable}
    begun = begun_run(work)
    if begun is not None:
        recorded, total = recorded_steps(begun)
        if recorded < total or work.first_step is not None:
            resume_scan(bench.rig, target, begun, first_step=work.first_step, **how)
        path = begun
    else:
        scan = recipe.scan(scan_defaults(bench.config))
        if isinstance(recipe, BscScan) and recipe.between:
            scan = scan.between()
        path = work.making("run")
        record_scan(bench.rig, scan, target, path, config_text=bench.config_text, **how)
    work.outputs["run"] = work.name
    with RunFile(path) as run:
        work.figures["frames"] = len(run.table())


def run_sphere(recipe: SphereCheck, work: Work) -> None:
    """Record the sphere and measure it at the desk: its figures are how far it is from a sphere."""
    bench, dic = work.bench, work.bench.config.dic
    calibration = work.given("calibration", recipe.calibration)
    run = begun_run(work)
    if run is None or not _complete(run):
        run = work.making("run")
        given = {"exposure_s": bench.config.scan.exposure_s, "gain_db": bench.config.scan.gain_db}
        sphere = recipe.sphere.model_copy(
            update={name: value for name, value in given.items() if getattr(recipe.sphere, name) is None}
        )
        record_sphere(
            bench.rig,
            sphere,
            run,
            config_text=bench.config_text,
            progress=work.progress("biprism heights"),
            stop=work.control.pausable,
        )
    work.outputs["run"] = work.name
    settings = MeasureSettings(step_px=recipe.step_px, subset_px=dic.subset_px, phase="sphere")
    task = MeasureTask(
        calibration,
        run,
        work.making("result"),
        settings,
        work.making("report"),
        sphere_radius_mm=bench.config.sphere.radius_mm,
    )
    work.figures |= do_at_the_desk(task, work.control, work.progress("frames"), work.reporting.warn)


def run_inflation(recipe: Inflation, work: Work) -> None:
    """Record an inflation, with live results where it has a calibration; it is vented however it ends."""
    bench, dic = work.bench, work.bench.config.dic
    given = {"exposure_s": bench.config.scan.exposure_s, "gain_db": bench.config.scan.gain_db}
    inflation = recipe.inflation.model_copy(
        update={name: value for name, value in given.items() if getattr(recipe.inflation, name) is None}
    )
    how: dict[str, Any] = {
        "config_text": bench.config_text,
        "progress": work.progress("frames"),
        "stop": work.control.stop_only,  # a membrane under pressure does not wait
        "storing": Storing(compression=recipe.compression, reserve_bytes=work.reserve_bytes),
        "followers": (work.watch,),
    }
    if recipe.calibration is None:
        done = record_inflation(bench.rig, inflation, work.making("run"), **how)
        _tell_recording(done, work)
        return
    calibration = work.given("calibration", recipe.calibration)
    run = work.making("run")
    done, outcome = record_and_measure(
        bench.rig,
        inflation,
        run,
        Calibration.load(calibration),
        work.making("result"),
        settings=MeasureSettings(step_px=recipe.step_px, subset_px=dic.subset_px, phase="inflation"),
        calibration_name=calibration.name,
        on_event=lambda event: _live(event, work),
        at_once=lambda: work.control.aborted is not None,
        **how,
    )
    _tell_recording(done, work)
    work.figures |= {
        "live_frames": outcome.frames - outcome.caught_up,
        "caught_up_frames": outcome.caught_up,
        "latency_median_s": outcome.latency_median_s,
        "latency_p99_s": outcome.latency_p99_s,
    }
    if outcome.failure:
        work.outputs.pop("result", None)
        work.reporting.warn(f"no live results: {outcome.failure}")


def begun_run(work: Work) -> Path | None:
    """The run of this name, when it was begun before; None otherwise."""
    return work.files.path("run", work.name) if work.files.has("run", work.name) else None


def _complete(path: Path) -> bool:
    with RunFile(path) as run:
        return run.state is RunState.COMPLETE


def _tell_recording(done: Recording, work: Work) -> None:
    work.figures |= {
        "frames": done.frames,
        "lost_frames": done.lost_frames,
        "incomplete_frames": done.incomplete_frames,
        "most_frames_waiting_for_the_disk": done.peak_fill,
        "ending": done.ending.value,
    }
    if done.reason:
        work.reporting.warn(f"the inflation ended by {done.ending.value}: {done.reason}")
    if not done.frames:
        raise CheckFailedError("inflation: no frame was recorded; look at the camera's trigger and rate")


def _live(event: LiveEvent, work: Work) -> None:
    if isinstance(event, LiveFailure):
        work.reporting.warn(f"live measuring failed, the recording goes on: {event.text}")
    elif isinstance(event, LiveWarning):
        work.reporting.warn(event.text)
    elif isinstance(event, LiveCatchingUp):
        now = Progress(event.done, event.total, "measuring the frames that were left out")
        work.reporting.progress(now, "frames")
    document = None
    if isinstance(event, LiveFrame):
        document = LiveDocument(
            frame=event.number,
            points=event.points,
            valid=event.valid,
            w_max_mm=None if math.isnan(event.w_max_mm) else event.w_max_mm,
            latency_s=event.latency_s,
            behind=max(work.watch.frames - event.number - 1, 0),
        )
    work.reporting.live(event, document)
