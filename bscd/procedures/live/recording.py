"""An inflation that is measured while it is recorded: the recording first, whatever becomes of the measurement."""

from __future__ import annotations

import math
import statistics
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bscd.acquisition import RunFile, RunState
from bscd.calibration import Calibration
from bscd.errors import BscdError, InputError
from bscd.procedures.live.follower import LiveFollower
from bscd.procedures.live.measurement import WAITING_MB, LiveMeasurement
from bscd.procedures.live.messages import LiveDone, LiveEvent, LiveSetup, LiveWarning
from bscd.procedures.measuring import MeasureSettings
from bscd.procedures.measuring.beginning import view_source
from bscd.procedures.measuring.frames import JACK_MM
from bscd.procedures.progress import ProcedureStoppedError
from bscd.procedures.recording import InflationRecipe, NotVentedError, Recording, record_inflation
from bscd.procedures.rehearsal import READOUT_RATE_PX_S
from bscd.procedures.rig import Rig
from bscd.results import Origin

#: Catching up ends when for so long no frame was measured: a worker gets eight of them at once.
_SILENT_S = 120.0

#: After a recording that ended early catching up may take as long as that took, and at least so long.
_LEAST_S = 60.0

_STOPPED = "stopped as asked while frames were measured that had been left out"

#: The live process loads its libraries before the recording begins, or what comes meanwhile would have to wait.
_LOAD_S = 60.0
_SLICE_S = 0.1


@dataclass(frozen=True)
class LiveOutcome:
    """What came of measuring live: frames in the results, latencies from exposure to map (s, NaN without any).

    ``left_out`` frames were not handed over in time and measured from the run file afterwards. ``failure`` is why
    there are no complete results, empty when there are.
    """

    frames: int
    caught_up: int
    left_out: int
    latency_median_s: float
    latency_p99_s: float
    worker_restarts: int
    failure: str = ""


def record_and_measure(
    rig: Rig,
    recipe: InflationRecipe,
    path: Path,
    calibration: Calibration,
    out: Path,
    *,
    settings: MeasureSettings | None = None,
    calibration_name: str = "",
    workers: int = 2,
    waiting_mb: float = WAITING_MB,
    title: str = "inflation",
    on_event: Callable[[LiveEvent], None] = lambda _: None,
    at_once: Callable[[], bool] = lambda: False,
    **recording: Any,
) -> tuple[Recording, LiveOutcome]:
    """Record as `record_inflation` (``recording`` are its arguments) and measure each frame as it arrives into ``out``.

    No more than ``waiting_mb`` MB of images wait for it in memory. What it could not take in time is measured from the
    run file when the membrane is vented, so every frame has its result; also when the recording was stopped or failed,
    of the frames that it has, before that is raised. A ``stop`` that comes meanwhile leaves the rest, and so does
    ``at_once`` when it says that all is to end now, whatever asked for it before. A measurement that fails or is left
    never ends the recording; its reason is in the outcome and in the results.

    Raises
    ------
    InputError
        Calibration, camera and rig do not fit each other, or ``out`` exists; nothing moved.
    """
    settings = settings or MeasureSettings(phase="inflation")
    if out.exists():
        raise InputError(f"{out}: exists already and results are never overwritten; choose another name")
    if abs(rig.raised_mm - calibration.jack_mm) > JACK_MM:
        raise InputError(
            f"live: the biprism is raised to {rig.raised_mm:g} mm, in the calibration it stood at "
            f"{calibration.jack_mm:g} mm; calibrate again, or correct [prism] raised_mm"
        )
    camera = rig.primary.info()
    size_px = camera.width_px, camera.height_px
    view_source(calibration, size_px, settings)  # refuses images that the calibration is not for
    setup = LiveSetup(
        calibration=calibration,
        size_px=size_px,
        out=out,
        title=title,
        run=Origin(path.name, "", ""),
        calibration_name=calibration_name,
        settings=settings,
        workers=workers,
    )
    with LiveMeasurement(setup, on_event, waiting_mb=waiting_mb) as live:
        stop: threading.Event | None = recording.get("stop")
        _wait_ready(live, stop)
        link_s = camera.width_px * camera.height_px / READOUT_RATE_PX_S
        follower = LiveFollower(live, link_s if recipe.readout_s is None else recipe.readout_s)
        followers: Sequence[Any] = (*recording.pop("followers", ()), follower)
        begun_s = time.monotonic()
        try:
            done = record_inflation(rig, recipe, path, title=title, followers=followers, **recording)
        except Exception as error:
            if not (isinstance(error, NotVentedError) or at_once()) and _has_frames(path):
                _finish_early(live, path, error, time.monotonic() - begun_s, on_event, _leaving(stop, at_once))
            raise
        failure, measured = "", LiveDone(0, 0, 0)
        try:
            measured = live.finish(path, _SILENT_S, leave=_leaving(stop, at_once))
        except BscdError as error:
            failure = str(error)
        return done, LiveOutcome(
            measured.frames,
            measured.caught_up,
            live.missed + follower.counts().left_out,
            *figures(live.latencies_s),
            measured.worker_restarts,
            failure,
        )


def _wait_ready(live: LiveMeasurement, stop: Any) -> None:
    """Until it can follow; whatever comes of it the recording begins, at once when it is to stop."""
    ends = time.monotonic() + _LOAD_S
    while not (live.wait_ready(_SLICE_S) or live.failure or time.monotonic() > ends):
        if stop is not None and stop.is_set():
            return


def _leaving(stop: threading.Event | None, at_once: Callable[[], bool]) -> Callable[[], str]:
    """What `LiveMeasurement.finish` asks: a stop that was asked for before this is no reason to leave."""
    heard = stop is not None and stop.is_set()

    def leave() -> str:
        asked = stop is not None and stop.is_set()  # looked at anyhow: whoever watches sees that somebody does
        return _STOPPED if at_once() or (asked and not heard) else ""

    return leave


def _has_frames(path: Path) -> bool:
    """Whether a run has ended and has something to measure."""
    try:
        with RunFile(path) as run:
            return run.state is not RunState.RECORDING and bool(len(run.table("primary", "inflation")))
    except BscdError:
        return False


def _finish_early(
    live: LiveMeasurement,
    path: Path,
    error: Exception,
    took_s: float,
    on_event: Callable[[LiveEvent], None],
    leave: Callable[[], str],
) -> None:
    """Measure what a recording has that ended with an error; that one stays the error to report."""
    if not isinstance(error, ProcedureStoppedError):
        on_event(LiveWarning(f"the recording ended early, the frames that it has are measured: {error}"))
    try:
        live.finish(path, _SILENT_S, most_s=max(_LEAST_S, took_s), leave=leave)
    except BscdError as why:
        on_event(LiveWarning(str(why)))


def figures(latencies_s: Sequence[float]) -> tuple[float, float]:
    """Median and 99th percentile, NaN without any."""
    if not latencies_s:
        return math.nan, math.nan
    ordered = sorted(latencies_s)
    return statistics.median(ordered), ordered[min(math.ceil(0.99 * len(ordered)), len(ordered)) - 1]
