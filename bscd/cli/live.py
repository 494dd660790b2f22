"""Show what is measured live beside the recording's progress."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import typer

from bscd.cli.following import following
from bscd.procedures import Progress, ProgressCallback, Rig
from bscd.procedures.live import LiveCatchingUp, LiveEvent, LiveFailure, LiveFrame, LiveOutcome, LiveWarning
from bscd.procedures.measuring import MeasureSettings
from bscd.procedures.recording import InflationRecipe

#: Half of each view, for the estimate: the membrane, without its ring and what is about it.
_MEASURED_SHARE = 0.25

BYTES_A_POINT = 170
"""What a results file takes for a point of a frame."""


@contextmanager
def live_progress() -> Iterator[tuple[ProgressCallback, Callable[[LiveEvent], None]]]:
    """A callback for the recording's progress and one for live events, which come from another thread."""
    last: list[LiveFrame] = []
    with following("Inflation", "frames") as recorded, following("Measuring the rest", "frames") as rest:

        def on_event(event: LiveEvent) -> None:
            if isinstance(event, LiveFrame):
                last[:] = [event]
            elif isinstance(event, LiveCatchingUp):
                rest(Progress(event.done, event.total, ""))
            elif isinstance(event, LiveWarning):
                typer.echo(f"warning: {event.text}", err=True)
            elif isinstance(event, LiveFailure):
                typer.echo(f"warning: live measuring failed, the recording goes on: {event.text}", err=True)

        def progress(now: Progress) -> None:
            recorded(replace(now, doing=f"{now.doing}, {_told_frame(last[0])}") if last else now)

        yield progress, on_event


def live_bytes(rig: Rig, recipe: InflationRecipe, settings: MeasureSettings, run: Path, results: Path) -> int:
    """About what the results will take of the run's disk; 0 where they go to another one."""
    folders = [path.absolute().parent for path in (run, results)]
    if not all(folder.is_dir() for folder in folders) or folders[0].stat().st_dev != folders[1].stat().st_dev:
        return 0
    camera = rig.primary.info()
    points = _MEASURED_SHARE * camera.width_px * camera.height_px / settings.step_px**2
    return round(recipe.frame_count * points * BYTES_A_POINT)


def told_live(outcome: LiveOutcome) -> str:
    """What came of it, in a line."""
    caught_up = f", {outcome.caught_up} of them after the recording" if outcome.caught_up else ", all live"
    restarts = f", {outcome.worker_restarts} workers started again" if outcome.worker_restarts else ""
    if math.isnan(outcome.latency_median_s):
        return f"{outcome.frames} frames{caught_up}{restarts}"
    latency = f"{outcome.latency_median_s * 1e3:.0f} ms, {outcome.latency_p99_s * 1e3:.0f} ms at the 99th percentile"
    return f"{outcome.frames} frames{caught_up}{restarts}; exposure to map {latency}"


def _told_frame(frame: LiveFrame) -> str:
    height = "" if math.isnan(frame.w_max_mm) else f"w up to {frame.w_max_mm:.2f} mm, "
    share = frame.valid / max(frame.points, 1)
    return f"frame {frame.number} measured, {height}{share:.0%} of {frame.points} points, {frame.latency_s:.2f} s after"
