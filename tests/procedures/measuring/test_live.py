"""Measured while frames arrive: the same as afterwards, whatever was missed and whoever was killed."""

import os
import signal
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.errors import BscdError
from bscd.procedures.live import LiveDone, LiveFailure, LiveFrame, LiveMeasurement, LiveSetup, LiveWarning
from bscd.procedures.measuring import MeasureSettings, measure_to_file
from bscd.results import Origin, ResultsFile
from drivers.interfaces import FrameStatus
from tests.procedures.measuring.twin_runs import write
from tests.results.measured import same

SETTINGS = MeasureSettings(step_px=20, strain=False, phase="inflation")
WAIT_S = 120.0


@pytest.fixture(scope="module")
def offline(wide, inflation_run, tmp_path_factory):
    """As `bscd measure` has it."""
    out = tmp_path_factory.mktemp("offline") / "offline.h5"
    with RunFile(inflation_run) as run:
        measure_to_file(wide, run, out, SETTINGS)
    with ResultsFile(out) as results:
        return list(results.frames())


def children(process_id):
    return [int(one) for one in Path(f"/proc/{process_id}/task/{process_id}/children").read_text().split()]


@contextmanager
def measuring(wide, inflation_run, out, *, events=None, **changes):
    setup = LiveSetup(
        calibration=wide,
        size_px=(1280, 1024),
        out=out,
        title="inflation",
        run=Origin(inflation_run.name, "", ""),
        settings=SETTINGS,
        nice=0,
        **{name: value for name, value in changes.items() if name != "waiting_mb"},
    )
    given = {"waiting_mb": changes["waiting_mb"]} if "waiting_mb" in changes else {}
    with LiveMeasurement(setup, (events if events is not None else []).append, **given) as live:
        yield live


def pushed(live, inflation_run, *, between=lambda number: None, skip=()):
    """All frames, one after the other; ``skip`` are those that nobody hands over."""
    with RunFile(inflation_run) as run:
        for number, frame in enumerate(run.frames("primary", "inflation")):
            between(number)
            if number not in skip:
                live.push(number, frame.data, frame.time_s, frame.pressure_kpa)


def until(condition, what):
    ends = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < ends, what
        time.sleep(0.01)


def all_the_same(out, offline):
    with ResultsFile(out) as results:
        assert results.complete
        assert results.verify() is None
        assert [same(one, other) for one, other in zip(results.frames(), offline, strict=True)] == [True] * len(offline)


def test_every_frame_is_told_with_its_latency_and_kept_as_measured_afterwards(wide, inflation_run, offline, tmp_path):
    events = []
    with measuring(wide, inflation_run, tmp_path / "live.h5", events=events) as live:
        pushed(live, inflation_run)
        done = live.finish(inflation_run, WAIT_S)
    assert done == LiveDone(frames=12, caught_up=0, worker_restarts=0)
    frames = [event for event in events if isinstance(event, LiveFrame)]
    assert [frame.number for frame in frames] == list(range(12))
    for frame, after in zip(frames, offline, strict=True):
        assert not frame.provisional
        assert (frame.points, frame.valid) == (len(after.status), int(after.valid.sum()))
        assert 50 < len(frame.index) <= 500
        np.testing.assert_array_equal(frame.uvw_mm, after.uvw_mm[frame.index])
        np.testing.assert_array_equal(frame.sigma_mm.astype(np.float32), after.sigma_mm[frame.index])
        np.testing.assert_array_equal(frame.zncc.astype(np.float32), after.zncc[frame.index])
        assert 0.0 < frame.latency_s < WAIT_S
    assert live.latencies_s == [frame.latency_s for frame in frames]
    all_the_same(tmp_path / "live.h5", offline)
    with ResultsFile(tmp_path / "live.h5") as results, RunFile(inflation_run) as run:
        assert (results.header.run.uuid, results.header.run.checksum) == (run.uuid, run.checksum)
        assert results.header.calibration.checksum == wide.checksum


@pytest.mark.parametrize("skip", [(0,), (4, 7, 9), tuple(range(12))], ids=str)
def test_frames_that_were_missed_are_measured_from_the_run(wide, inflation_run, offline, tmp_path, skip):
    events = []
    with measuring(wide, inflation_run, tmp_path / "live.h5", events=events) as live:
        pushed(live, inflation_run, skip=skip)
        done = live.finish(inflation_run, WAIT_S)
    assert (done.frames, done.caught_up) == (12, 12 - min(skip))
    told = [event for event in events if isinstance(event, LiveFrame)]
    assert [frame.number for frame in told if not frame.provisional] == list(range(min(skip)))
    all_the_same(tmp_path / "live.h5", offline)


def test_one_that_can_not_follow_misses_frames_and_never_waits(wide, inflation_run, offline, tmp_path):
    with measuring(wide, inflation_run, tmp_path / "live.h5", waiting_mb=3.0) as live:
        os.kill(live.process_id, signal.SIGSTOP)
        pushed(live, inflation_run)
        assert (live.pushed, live.missed) == (2, 10)
        os.kill(live.process_id, signal.SIGCONT)
        done = live.finish(inflation_run, WAIT_S)
    assert (done.frames, done.caught_up) == (12, 12)  # too few to know the reference by
    all_the_same(tmp_path / "live.h5", offline)


def test_a_worker_that_is_killed_costs_time_not_results(wide, inflation_run, offline, tmp_path):
    events = []
    with measuring(wide, inflation_run, tmp_path / "live.h5", events=events) as live:

        def kill(number):
            if number == 6:
                until(lambda: len(events) >= 3, "the first frames are measured")
                os.kill(children(live.process_id)[0], signal.SIGKILL)

        pushed(live, inflation_run, between=kill)
        done = live.finish(inflation_run, WAIT_S)
    assert (done.frames, done.worker_restarts) == (12, 1)
    all_the_same(tmp_path / "live.h5", offline)


def test_a_live_process_that_is_killed_is_told_and_pushing_goes_on(wide, inflation_run, tmp_path):
    out = tmp_path / "live.h5"
    with measuring(wide, inflation_run, out) as live:

        def kill(number):
            if number == 6:
                until(lambda: live.latencies_s, "the first frame is measured")
                os.kill(live.process_id, signal.SIGKILL)
                until(lambda: live.failure, "its end is noticed")

        pushed(live, inflation_run, between=kill)
        assert (live.pushed, live.missed) == (6, 6)
        with pytest.raises(BscdError, match="the live process ended; the run is whole, measure it with bscd measure"):
            live.finish(inflation_run, WAIT_S)
    assert not [name for name in os.listdir("/dev/shm") if name.startswith(f"bscd-{os.getpid()}-")]


def test_it_says_when_it_can_follow_and_that_it_never_will(wide, inflation_run, tmp_path):
    with measuring(wide, inflation_run, tmp_path / "live.h5") as live:
        assert live.wait_ready(0.0) is False
        assert live.wait_ready(WAIT_S) is True
        os.kill(live.process_id, signal.SIGKILL)
        until(lambda: live.failure, "its end is noticed")
        begun_s = time.monotonic()
        assert live.wait_ready(WAIT_S) is False
        assert time.monotonic() - begun_s < 5.0


def test_what_goes_wrong_in_it_is_told_in_a_sentence(wide, inflation_run, tmp_path):
    events, out = [], tmp_path / "live.h5"
    out.touch()
    with measuring(wide, inflation_run, out, events=events) as live:
        pushed(live, inflation_run)
        with pytest.raises(BscdError, match=r"live measuring failed: .*live\.h5 exists already"):
            live.finish(inflation_run, WAIT_S)
    assert isinstance(events[-1], LiveFailure)


def test_a_damaged_frame_keeps_its_number_and_costs_nothing(wide, inflation_run, tmp_path):
    with RunFile(inflation_run) as run:
        frames = list(run.frames("primary", "inflation"))
    for number in (1, 5):
        frames[number] = replace(frames[number], status=FrameStatus.INCOMPLETE)
    damaged_run, events = write(tmp_path / "run.h5", frames), []
    with measuring(wide, damaged_run, tmp_path / "live.h5", events=events) as live:
        for number, frame in enumerate(frames):
            if frame.status is FrameStatus.OK:
                live.push(number, frame.data, frame.time_s, frame.pressure_kpa)
            else:
                live.skip(number)
        assert live.finish(damaged_run, WAIT_S) == LiveDone(frames=10, caught_up=0, worker_restarts=0)
    assert [event.text for event in events if isinstance(event, LiveWarning)] == [
        f"{damaged_run}: 2 of 12 inflation frames are left out: 2 incomplete in the primary camera (frames 1, 5)"
    ]
    with RunFile(damaged_run) as run:
        measure_to_file(wide, run, tmp_path / "after.h5", SETTINGS)
    with ResultsFile(tmp_path / "after.h5") as results:
        after = list(results.frames())
    assert [frame.number for frame in after] == [0, 2, 3, 4, 6, 7, 8, 9, 10, 11]
    all_the_same(tmp_path / "live.h5", after)


def test_all_is_measured_again_when_the_reference_turns_out_to_be_another(wide, inflation_run, offline, tmp_path):
    events = []
    with measuring(wide, inflation_run, tmp_path / "live.h5", events=events) as live:
        with RunFile(inflation_run) as run:
            for number, frame in enumerate(run.frames("primary", "inflation")):
                live.push(number, frame.data, frame.time_s, frame.pressure_kpa if number else float("nan"))
        done = live.finish(inflation_run, WAIT_S)
    assert (done.frames, done.caught_up) == (12, 12)
    texts = [event.text for event in events if isinstance(event, LiveWarning)]
    assert sum("its reference is another than it was live; all is measured once more" in text for text in texts) == 1
    all_the_same(tmp_path / "live.h5", offline)


def test_leaving_early_keeps_what_there_is(wide, inflation_run, offline, tmp_path):
    with measuring(wide, inflation_run, tmp_path / "live.h5") as live:
        pushed(live, inflation_run)
        until(lambda: len(live.latencies_s) >= 4, "four frames are measured")
    with ResultsFile(tmp_path / "live.h5") as results:
        assert not results.complete
        frames = list(results.frames())
        assert results.reason == "it was ended before all was measured"
        assert all(same(one, other) for one, other in zip(frames, offline, strict=False))
