"""An inflation that is measured while it is recorded: the recording first, whatever becomes of the measurement."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bscd.calibration import Calibration
from bscd.errors import BscdError, InputError
from bscd.procedures.live.follower import LiveFollower
from bscd.procedures.live.measurement import WAITING_MB, LiveMeasurement
from bscd.procedures.live.messages import LiveDone, LiveEvent, LiveSetup
from bscd.procedures.measuring import MeasureSettings
from bscd.procedures.measuring.beginning import view_source
from bscd.procedures.measuring.frames import JACK_MM
from bscd.procedures.recording import InflationRecipe, Recording, record_inflation
from bscd.procedures.rig import Rig
from bscd.results import Origin

#: Catching up may take so long for each frame, and at least so long.
_CATCH_UP_S = 10.0
_LEAST_S = 60.0

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
    **recording: Any,
) -> tuple[Recording, LiveOutcome]:
    """Record as `record_inflation` (``recording`` are its arguments) and measure each frame as it arrives into ``out``.

    No more than ``waiting_mb`` MB of images wait for it in memory. What it could not take in time is measured from the
    run file when the membrane is vented, so every frame has its result. A measurement that fails never ends the
    recording; its reason is in the outcome.

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
        _wait_ready(live, recording.get("stop"))
        follower = LiveFollower(live)
        followers: Sequence[Any] = (*recording.pop("followers", ()), follower)
        done = record_inflation(rig, recipe, path, title=title, followers=followers, **recording)
        failure, measured = "", LiveDone(0, 0, 0)
        try:
            measured = live.finish(path, max(_LEAST_S, _CATCH_UP_S * done.frames))
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


def figures(latencies_s: Sequence[float]) -> tuple[float, float]:
    """Median and 99th percentile, NaN without any."""
    if not latencies_s:
        return math.nan, math.nan
    ordered = sorted(latencies_s)
    return statistics.median(ordered), ordered[min(math.ceil(0.99 * len(ordered)), len(ordered)) - 1]
