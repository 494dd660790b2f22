"""DIC while recording: a replay camera at 11 fps, 1280x1024, so that rendering costs nothing; part of `bench stream`.

A membrane of the twin goes up and down by 16 kPa, three times in 30 s, after 24 frames at rest.
"""

from __future__ import annotations

import os
import signal
import tempfile
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np

from bscd.acquisition import FrameRecord, RunFile, RunWriter
from bscd.acquisition.replay import ReplayCamera, ReplayOptions
from bscd.cli.record import DEFAULT_CONFIG, rig_of
from bscd.config import load_config
from bscd.procedures.live import LiveFrame, LiveOutcome, record_and_measure
from bscd.procedures.live import recording as live_recording
from bscd.procedures.measuring import MeasureSettings, measure_to_file
from bscd.procedures.recording import InflationRecipe, Recording, Storing
from bscd.results import ResultsFile
from tests.procedures.measuring.twin_runs import CAMERA, RAISED_MM, REST_KPA, TwinRuns, wide_calibration
from tests.results.measured import same

REST, LEVELS, TIMES, RATE_HZ = 24, 50, 3, 11.0
STEPS_PX = (10, 7, 6, 5, 3)


def membrane(path: Path) -> Path:
    """The run that is replayed."""
    twin = TwinRuns()
    try:
        up = [twin.image(twin.inflated(kpa)) for kpa in np.linspace(REST_KPA, 16.0, LEVELS + 1)[1:]]
        at_rest = [twin.image(twin.inflated(REST_KPA)) for _ in range(REST)]
    finally:
        twin.world.close()
    images = at_rest + [*up, *up[-2::-1], at_rest[0]] * TIMES
    with RunWriter(path, title="replayed", cameras={"primary": CAMERA}) as writer:
        for number, image in enumerate(images):
            writer.append(
                FrameRecord("primary", "inflation", image, number, jack_mm=RAISED_MM, time_s=number / RATE_HZ)
            )
    return path


def record_live(
    folder: Path, source: Path, step_px: int, *, kill: str = ""
) -> tuple[Recording, LiveOutcome, list[LiveFrame], int]:
    """One recording of 30 s with live results in ``folder``; ``kill`` "workers" or "process" every few seconds."""
    events: list[LiveFrame] = []
    duration_s = 2 * LEVELS * TIMES / RATE_HZ
    recipe = InflationRecipe(rest_frames=REST, ramp_s=duration_s, hold_s=0.0, rest_settle_s=0.5, exposure_s=0.02)
    config, ended = load_config(DEFAULT_CONFIG), threading.Event()
    before = set(_programs())

    def killer() -> None:
        while not ended.wait(6.0):
            for process_id in set(_programs()) - before:
                with open(f"/proc/{process_id}/cmdline", "rb") as file:
                    if {"workers": b"pool.worker", "process": b"live.process"}[kill] in file.read():
                        os.kill(process_id, signal.SIGKILL)

    with rig_of(config, rest_kpa=REST_KPA) as rig:
        options = ReplayOptions(source=source, pace="rate", frame_rate_hz=RATE_HZ)
        camera = ReplayCamera(options, "primary", rig.clock)
        rig = replace(rig, primary=camera)
        camera.connect()
        thread = threading.Thread(target=killer) if kill else None
        if thread is not None:
            thread.start()
        try:
            done, outcome = record_and_measure(
                rig,
                recipe,
                folder / "run.h5",
                wide_calibration(),
                folder / "live.h5",
                settings=MeasureSettings(step_px=step_px, phase="inflation"),
                on_event=lambda event: events.append(event) if isinstance(event, LiveFrame) else None,
                storing=Storing(),
            )
        finally:
            ended.set()
            if thread is not None:
                thread.join()
            camera.close()
    return done, outcome, events, recipe.frame_count


def compare(folder: Path, step_px: int) -> str:
    """Live results beside `bscd measure` of the same run."""
    settings = MeasureSettings(step_px=step_px, phase="inflation")
    with RunFile(folder / "run.h5") as run:
        measure_to_file(wide_calibration(), run, folder / "after.h5", settings)
    with ResultsFile(folder / "live.h5") as live, ResultsFile(folder / "after.h5") as after:
        equal = [same(one, other) for one, other in zip(live.frames(), after.frames(), strict=True)]
    return f"{sum(equal)} of {len(equal)} frames equal bit for bit to bscd measure"


def main() -> None:
    """Print a line for each density, then overloaded and with processes killed."""
    print(
        f"live DIC at {RATE_HZ:g} fps, replay camera, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}", flush=True
    )
    live_recording._SILENT_S = 600.0  # a busy computer
    with tempfile.TemporaryDirectory(prefix=".bench-live-", dir=".") as name:
        source = membrane(Path(name) / "source.h5")
        for step_px, kill in [*((step_px, "") for step_px in STEPS_PX), (10, "workers"), (10, "process")]:
            folder = Path(name) / f"{step_px}{kill}"
            folder.mkdir()
            done, outcome, events, planned = record_live(folder, source, step_px, kill=kill)
            points = max((event.points for event in events), default=0)
            print(
                f"step {step_px:2d} px, {points:5d} points{_how(step_px, kill):16s}: "
                f"recorded {done.frames} of {planned}, {done.lost_frames} lost, ring at most {done.peak_fill}; "
                f"live {len(events)}, skipped {outcome.left_out}, latency {outcome.latency_median_s * 1e3:.0f} ms, "
                f"p99 {outcome.latency_p99_s * 1e3:.0f} ms; results of {outcome.frames} frames"
                f"{f', {outcome.failure}' if outcome.failure else ''}",
                flush=True,
            )
            if step_px == 10 and not kill:
                print(f"  {compare(folder, step_px)}", flush=True)
            for file in folder.iterdir():
                file.unlink()


def _how(step_px: int, kill: str) -> str:
    if kill:
        return f", {kill} killed"
    return ", overload" if step_px == min(STEPS_PX) else ""


def _programs() -> list[int]:
    return [int(one) for one in os.listdir("/proc") if one.isdigit()]


if __name__ == "__main__":
    main()
