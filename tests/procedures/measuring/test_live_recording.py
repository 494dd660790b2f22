"""A recording that is measured while it goes on: every frame has its result, and the recording never pays for it."""

import os
import signal
import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from bscd.acquisition import CameraMeta, RunFile, RunState
from bscd.acquisition.replay import ReplayCamera, ReplayOptions
from bscd.cli.app import run as bscd
from bscd.cli.record import DEFAULT_CONFIG, rig_of
from bscd.config import load_config
from bscd.errors import InputError
from bscd.procedures import ProcedureStoppedError
from bscd.procedures.live import LiveFrame, LiveMeasurement, record_and_measure
from bscd.procedures.measuring import MeasureSettings, measure_to_file
from bscd.procedures.recording import InflationRecipe
from bscd.results import ResultsFile
from tests.procedures.measuring.twin_runs import PRESSURES_KPA, RAISED_MM, REST_KPA, write
from tests.results.measured import same

STEP_PX = 40
FRAMES = len(PRESSURES_KPA)
REST_FRAMES = 3


@contextmanager
def replaying(source, rate_hz=11.0, frames=FRAMES):
    """The twin's rig with a recorded membrane before its camera, over and over, and a recipe for so many frames."""
    with rig_of(load_config(DEFAULT_CONFIG), rest_kpa=REST_KPA) as rig:
        options = ReplayOptions(source=source, pace="rate", frame_rate_hz=rate_hz, exposure_s=0.005, repeat=True)
        camera = ReplayCamera(options, "primary", rig.clock)
        camera.connect()
        try:
            yield (
                replace(rig, primary=camera),
                InflationRecipe(
                    rest_frames=REST_FRAMES,
                    ramp_s=(frames - REST_FRAMES) / rate_hz,
                    hold_s=0.0,
                    rest_settle_s=0.3,
                    frame_rate_hz=rate_hz,
                    exposure_s=0.005,
                ),
            )
        finally:
            camera.close()


def measured(rig, recipe, wide, folder, **changes):
    settings = MeasureSettings(step_px=STEP_PX, strain=False, phase="inflation")
    return record_and_measure(rig, recipe, folder / "run.h5", wide, folder / "live.h5", settings=settings, **changes)


def as_measured_afterwards(wide, folder, state=RunState.COMPLETE):
    """How many frames of the live results are bit for bit those of `bscd measure`."""
    with RunFile(folder / "run.h5") as run:
        assert run.state is state
        assert run.verify() is None
        settings = MeasureSettings(step_px=STEP_PX, strain=False, phase="inflation")
        measure_to_file(wide, run, folder / "after.h5", settings)
    with ResultsFile(folder / "live.h5") as live, ResultsFile(folder / "after.h5") as after:
        assert live.complete
        return sum(same(one, other) for one, other in zip(live.frames(), after.frames(), strict=True))


def test_what_an_overloaded_measurement_left_out_is_measured_from_the_run(wide, inflation_run, tmp_path):
    frames = 36
    events = []
    with replaying(inflation_run, rate_hz=120.0, frames=frames) as (rig, recipe):
        done, outcome = measured(rig, recipe, wide, tmp_path, workers=1, waiting_mb=16.0, on_event=events.append)
    assert (done.frames, done.lost_frames, outcome.failure) == (frames, 0, "")
    assert outcome.left_out > 0
    assert outcome.caught_up >= outcome.left_out
    assert outcome.frames == frames
    live = sum(isinstance(event, LiveFrame) for event in events)
    assert live + outcome.caught_up >= frames  # those after the first that was left out are measured again
    assert 0.0 < outcome.latency_median_s <= outcome.latency_p99_s
    assert as_measured_afterwards(wide, tmp_path) == frames


def test_a_measurement_that_dies_leaves_the_recording_whole(wide, inflation_run, tmp_path):
    def kill(event):
        for process_id in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split():
            if b"bscd.procedures.live.process" in Path(f"/proc/{process_id}/cmdline").read_bytes():
                os.kill(int(process_id), signal.SIGKILL)

    with replaying(inflation_run) as (rig, recipe):
        done, outcome = measured(rig, recipe, wide, tmp_path, on_event=kill)
    assert (done.frames, done.lost_frames) == (len(PRESSURES_KPA), 0)
    assert "live" in outcome.failure
    assert "bscd measure" in outcome.failure
    with RunFile(tmp_path / "run.h5") as run:
        assert run.complete
        assert run.verify() is None


def test_a_stop_while_the_measurement_loads_is_heard_at_once(wide, inflation_run, tmp_path, monkeypatch):
    monkeypatch.setattr(LiveMeasurement, "wait_ready", lambda self, timeout_s: time.sleep(timeout_s))  # never loaded
    stop = threading.Event()
    timer = threading.Timer(1.0, stop.set)
    with replaying(inflation_run) as (rig, recipe):
        timer.start()
        begun_s = time.monotonic()
        with pytest.raises(ProcedureStoppedError, match="before it began"):
            measured(rig, recipe, wide, tmp_path, stop=stop)
        assert time.monotonic() - begun_s < 30.0  # it would wait for a minute
    assert [one.name for one in tmp_path.iterdir()] == ["run.h5"]


def test_what_does_not_fit_is_refused_before_anything_moves(wide, inflation_run, tmp_path):
    with replaying(inflation_run) as (rig, recipe):
        before = rig.jacks.status().position, rig.rotation.status().position
        with pytest.raises(InputError, match=r"raised to 60 mm, in the calibration it stood at 70 mm; calibrate again"):
            measured(replace(rig, raised_mm=RAISED_MM - 10.0), recipe, wide, tmp_path)
        (tmp_path / "live.h5").write_bytes(b"kept")
        with pytest.raises(InputError, match=r"live\.h5: exists already and results are never overwritten"):
            measured(rig, recipe, wide, tmp_path)
        assert (rig.jacks.status().position, rig.rotation.status().position) == before
    assert [one.name for one in tmp_path.iterdir()] == ["live.h5"]
    assert (tmp_path / "live.h5").read_bytes() == b"kept"


def test_images_of_another_size_are_refused(wide, inflation_run, tmp_path):
    with RunFile(inflation_run) as run:
        frames = [replace(frame, data=frame.data[::2, ::2]) for frame in run.frames("primary", "inflation")]
    small = write(tmp_path / "small.h5", frames, camera=CameraMeta(640, 512, 8, 0.0134))
    with replaying(small) as (rig, recipe), pytest.raises(InputError, match="640 x 512"):
        measured(rig, recipe, wide, tmp_path)
    assert [one.name for one in tmp_path.iterdir()] == ["small.h5"]


def test_the_command_measures_what_it_records(wide, inflation_run, tmp_path, capsys):
    wide.save(tmp_path / "cal.h5")
    text = DEFAULT_CONFIG.read_text()
    simulated = 'driver = "camera.simulated"\ncamera = "primary"'
    assert text.count(simulated) == 1
    replay = f'driver = "camera.replay"\nsource = "{inflation_run}"\nexposure_s = 0.02\nrepeat = true'
    (tmp_path / "rig.toml").write_text(text.replace(simulated, replay))
    paths = [str(tmp_path / name) for name in ("run.h5", "rig.toml", "cal.h5")]
    command = ["record", paths[0], "--config", paths[1], "--calibration", paths[2], "--step", str(STEP_PX)]
    assert bscd([*command, "--rest-frames", "3", "--duration", "0.8", "--top", "4"]) == 0
    told = capsys.readouterr().out
    assert "run.h5: 12 frames at 11 a second, 0 lost" in told
    assert "run-result.h5: 12 frames" in told
    assert "exposure to map" in told
    (tmp_path / "run-result.h5").rename(tmp_path / "live.h5")
    assert as_measured_afterwards(wide, tmp_path) == 12
    assert bscd([*command[:1], str(tmp_path / "other.h5"), "--results", "x.h5"]) == 2
    assert "--results and --step need --calibration" in capsys.readouterr().err
