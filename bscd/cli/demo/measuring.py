"""The demo's measurement: a sphere and an inflation recorded on the twin, and measured from their files."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import typer

from bscd.acquisition import RunFile
from bscd.arrays import FloatArray
from bscd.calibration import Calibration
from bscd.cli.following import following
from bscd.cli.twin_truth import Missed, WitnessedWorld, missed_of_truth, true_centre_mm
from bscd.config import RigConfig
from bscd.procedures import Progress, Rig
from bscd.procedures.measuring import MeasureSettings, measure_to_file
from bscd.procedures.recording import InflationRecipe, Recording, SphereRecipe, record_inflation, record_sphere
from bscd.results import ResultsFile, StereoSource

SPHERE, SPHERE_RESULT, SPHERE_STANDARD = "sphere.h5", "sphere-result.h5", "sphere-standard-result.h5"
INFLATION, INFLATION_RESULT = "inflation.h5", "inflation-result.h5"


@dataclass(frozen=True, eq=False)
class Inflated:
    """What the inflation's recording came to, how fast it was measured, and what the frames miss of the truth.

    ``sphere_centre_mm`` ``(3,)`` is where the sphere truly was.
    """

    recording: Recording
    live_fps: float
    missed: Missed
    sphere_centre_mm: FloatArray


def record(rig: Rig, world: WitnessedWorld, config: RigConfig, text: str, out: Path) -> Recording:
    """Record both; the inflation comes first, while the biprism has not moved since the calibration.

    The objects are put on the stage by hand, as an operator would; returns the inflation's recording.
    """
    scan = config.scan
    inflate = InflationRecipe(exposure_s=scan.exposure_s, gain_db=scan.gain_db)
    look = SphereRecipe(exposure_s=scan.exposure_s, gain_db=scan.gain_db)
    world.place("membrane")
    with following("Inflation", "frames") as progress:
        inflation = record_inflation(rig, inflate, out / INFLATION, config_text=text, progress=progress)
    world.place("sphere")
    with following("Sphere", "biprism heights") as progress:
        record_sphere(rig, look, out / SPHERE, config_text=text, progress=progress)
    return inflation


def measure(
    calibration: Calibration, recording: Recording, world: WitnessedWorld, config: RigConfig, out: Path
) -> Inflated:
    """Measure both runs into results files."""
    _measure(calibration, config, out / SPHERE, out / SPHERE_RESULT, "biprism", "Measuring the sphere")
    _measure(calibration, config, out / SPHERE, out / SPHERE_STANDARD, "standard", "Measuring by the pair")
    live_fps = _measure(
        calibration, config, out / INFLATION, out / INFLATION_RESULT, "biprism", "Measuring the inflation"
    )
    with ResultsFile(out / SPHERE_RESULT) as results, RunFile(out / SPHERE) as run:
        centre_mm = true_centre_mm(results, run, world)
    with ResultsFile(out / INFLATION_RESULT) as results, RunFile(out / INFLATION) as run:
        return Inflated(recording, live_fps, missed_of_truth(results, run, world, calibration.hull), centre_mm)


def _measure(
    calibration: Calibration, config: RigConfig, source: Path, result: Path, stereo: StereoSource, title: str
) -> float:
    """Measure one run; frames a second from the first to the last, without what comes once before them."""
    settings = MeasureSettings(step_px=config.dic.step_px, subset_px=config.dic.subset_px, stereo=stereo)
    times: list[float] = []

    def timed(show: Callable[[Progress], None]) -> Callable[[Progress], None]:
        def report(now: Progress) -> None:
            times.append(time.monotonic())
            show(now)

        return report

    with RunFile(source) as run, following(title, "frames") as progress:
        measure_to_file(
            calibration,
            run,
            result,
            settings,
            calibration_name="calibration.h5",
            progress=timed(progress),
            warn=lambda text: typer.echo(f"warning: {text}", err=True),
        )
    return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else float("nan")


def summary(inflated: Inflated, out: Path) -> dict[str, Any]:
    """The inflation's part of summary.json.

    ``truth_w_rms`` is over the frames that took no part in the reference; ``truth_worst`` and ``kept_worst`` are of the
    frame that misses the most.
    """
    with ResultsFile(out / INFLATION_RESULT) as results:
        valid = results.array("status") == 0
        w = np.where(valid, results.array("uvw_mm")[:, :, 2], np.nan)
        time_s = results.array("time_s")
        loaded = np.setdiff1d(np.arange(len(time_s)), results.header.reference_frames)
        count = valid[loaded].sum(axis=1)
        return {
            "frames": inflated.recording.frames,
            "fps": float((len(time_s) - 1) / (time_s[-1] - time_s[0])),
            "dropped": inflated.recording.dropped,
            "points": len(results.points_px),
            "live_fps": inflated.live_fps,
            "w_max": float(np.nanmax(w)),
            "truth_w_rms": float(np.sqrt(np.average(inflated.missed.uvw_rms_mm[loaded, 2] ** 2, weights=count))),
            "truth_worst": dict(zip("uvw", np.max(inflated.missed.uvw_rms_mm, axis=0).tolist(), strict=True)),
            "kept_worst": float(np.min(inflated.missed.kept)),
        }
