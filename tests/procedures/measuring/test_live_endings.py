"""However a live measurement ends: the results are complete or say why not, and nobody waits for what hangs."""

import os
import signal
import threading
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from bscd.acquisition import RunFile, RunState
from bscd.errors import BscdError
from bscd.procedures import ProcedureStoppedError
from bscd.procedures.live import LiveCatchingUp, LiveFrame, LiveWarning
from bscd.procedures.live import recording as live_recording
from bscd.procedures.recording import NotVentedError
from bscd.results import ResultsFile
from drivers.errors import DeviceError
from tests.procedures.measuring.test_live import WAIT_S, children, measuring, pushed, until
from tests.procedures.measuring.test_live_recording import as_measured_afterwards, measured, replaying

QUICK = {"rate_hz": 20.0, "frames": 400}
BEHIND = {"workers": 1, "waiting_mb": 8.0}
"""What a measurement has that leaves frames out at that rate."""
MOST = 100
"""Frames after which a recording is ended that waits for the first live result: on a busy computer that takes long."""


class Replaced:
    """A device, but for what a test does to it."""

    def __init__(self, device):
        self._device = device

    def __getattr__(self, name):
        return getattr(self._device, name)


class FailingCamera(Replaced):
    failed = False
    frames = 0

    def read(self, timeout_s=5.0):
        if self.failed or self.frames == MOST:
            raise DeviceError("primary", "its power was switched off")
        frame = self._device.read(timeout_s)
        self.frames += 1
        return frame


class StuckValve(Replaced):
    def vent(self):
        raise DeviceError("pressure", "the valve does not answer")


def live_process():
    """The number of this process's live one."""
    for number in children(os.getpid()):
        if b"bscd.procedures.live.process" in Path(f"/proc/{number}/cmdline").read_bytes():
            return number
    raise AssertionError("there is none")


def ending_of(path):
    """A results file's state, reason, and the run that it names."""
    with ResultsFile(path) as results:
        return results.state, results.reason, results.header.run.uuid


def told_early(events):
    """What was said of a recording that ended early."""
    texts = [event.text for event in events if isinstance(event, LiveWarning)]
    return [text for text in texts if "ended early, the frames that it has are measured" in text]


@pytest.fixture
def patient(monkeypatch):
    """A computer that does much else takes longer to catch up than it may."""
    monkeypatch.setattr(live_recording, "_LEAST_S", WAIT_S)


def test_a_stop_leaves_a_result_of_every_recorded_frame(wide, inflation_run, tmp_path, capfd, patient):
    stop, events = threading.Event(), []

    def on_event(event):
        events.append(event)
        if isinstance(event, LiveFrame):
            stop.set()

    def progress(now):
        if now.done == MOST:
            stop.set()

    stopped = pytest.raises(ProcedureStoppedError, match="stopped as asked")
    with replaying(inflation_run, **QUICK) as (rig, recipe), stopped:
        measured(rig, recipe, wide, tmp_path, stop=stop, on_event=on_event, progress=progress, **BEHIND)
    assert capfd.readouterr().err == ""
    with RunFile(tmp_path / "run.h5") as run:
        assert run.state is RunState.INTERRUPTED
        recorded = len(run.table())
        assert ending_of(tmp_path / "live.h5") == (RunState.COMPLETE, "", run.uuid)
    assert as_measured_afterwards(wide, tmp_path, RunState.INTERRUPTED) == recorded < QUICK["frames"]
    told = [(event.done, event.total) for event in events if isinstance(event, LiveCatchingUp)]
    assert told == [(done, told[-1][1]) for done in range(told[-1][1] + 1)]
    assert not told_early(events)


def test_a_failure_leaves_a_result_of_every_frame_and_is_told_before(wide, inflation_run, tmp_path, capfd, patient):
    events = []
    with replaying(inflation_run, **QUICK) as (rig, recipe):
        camera = FailingCamera(rig.primary)

        def on_event(event):
            events.append(event)
            camera.failed |= isinstance(event, LiveFrame)

        with pytest.raises(DeviceError, match="its power was switched off"):
            measured(replace(rig, primary=camera), recipe, wide, tmp_path, on_event=on_event, **BEHIND)
    assert capfd.readouterr().err == ""
    (warning,) = told_early(events)
    assert "its power was switched off" in warning
    with RunFile(tmp_path / "run.h5") as run, ResultsFile(tmp_path / "live.h5") as results:
        assert results.complete
        assert len(results) == len(run.table()) < QUICK["frames"]


@pytest.mark.parametrize("why", ["all is to end at once", "not vented"])
def test_what_can_not_wait_is_told_at_once(wide, inflation_run, tmp_path, why, capfd):
    stop = threading.Event()
    with replaying(inflation_run, **QUICK) as (rig, recipe):
        vented = why != "not vented"
        rig = rig if vented else replace(rig, pressure=StuckValve(rig.pressure))
        with pytest.raises(ProcedureStoppedError if vented else NotVentedError) as raised:
            measured(
                rig,
                recipe,
                wide,
                tmp_path,
                stop=stop,
                at_once=lambda: vented and stop.is_set(),
                on_event=lambda event: stop.set() if isinstance(event, LiveFrame) else None,
                **BEHIND,
            )
    assert capfd.readouterr().err == ""
    state, reason, _ = ending_of(tmp_path / "live.h5")
    assert (state, reason) == (RunState.INTERRUPTED, str(raised.value))
    with RunFile(tmp_path / "run.h5") as run, ResultsFile(tmp_path / "live.h5") as results:
        assert 0 < len(results) < len(run.table())


@pytest.mark.parametrize("by", ["stop", "at_once"])
def test_catching_up_can_be_stopped(wide, inflation_run, tmp_path, by, capfd):
    stop = threading.Event()

    def on_event(event):
        if isinstance(event, LiveCatchingUp) and event.done == 1:
            process_id = live_process()
            os.kill(process_id, signal.SIGSTOP)  # so that it is not done before it hears of it
            threading.Timer(1.0, os.kill, (process_id, signal.SIGCONT)).start()
            stop.set()

    how = {"stop": stop} if by == "stop" else {"at_once": stop.is_set}
    with replaying(inflation_run, rate_hz=60.0, frames=60) as (rig, recipe):
        done, outcome = measured(rig, recipe, wide, tmp_path, on_event=on_event, **how, **BEHIND)
    assert capfd.readouterr().err == ""
    assert (done.frames, done.lost_frames) == (60, 0)
    assert "stopped as asked" in outcome.failure
    assert "bscd measure" in outcome.failure
    with RunFile(tmp_path / "run.h5") as run:
        assert run.complete
        state, reason, measured_run = ending_of(tmp_path / "live.h5")
        assert (state, measured_run) == (RunState.INTERRUPTED, run.uuid)
    assert "stopped as asked" in reason
    with ResultsFile(tmp_path / "live.h5") as results:
        assert 0 < len(results) < 60


def test_time_runs_from_the_last_sign_of_progress(wide, inflation_run, tmp_path):
    with measuring(wide, inflation_run, tmp_path / "live.h5", events=Slow(0.8)) as live:
        assert live.wait_ready(WAIT_S)
        begun_s = time.monotonic()
        assert live.finish(inflation_run, 7.0).frames == 12
        assert time.monotonic() - begun_s > 7.0


class Slow(list):
    """Events that each take so long."""

    def __init__(self, lasting_s):
        super().__init__()
        self._lasting_s = lasting_s

    def append(self, event):
        super().append(event)
        time.sleep(self._lasting_s)


def test_a_failure_with_frames_under_way_is_the_reason_in_the_results(wide, inflation_run, tmp_path, capfd):
    ended, events = threading.Event(), []

    def killing():
        while not ended.wait(0.05):
            for each in Path(f"/proc/{live.process_id}/task").glob("*/children"):  # by the thread that began them
                with suppress(OSError):  # it is gone meanwhile
                    for number in each.read_text().split():
                        if b"pool.worker" in Path(f"/proc/{number}/cmdline").read_bytes():
                            os.kill(int(number), signal.SIGKILL)

    with measuring(wide, inflation_run, tmp_path / "live.h5", events=events) as live:
        killer = threading.Thread(target=killing)

        def kill(number):
            if number == 6:
                until(lambda: len(events) >= 3, "the first frames are measured")
                killer.start()

        try:
            pushed(live, inflation_run, between=kill)
            with pytest.raises(BscdError, match="two workers in turn died"):
                live.finish(inflation_run, WAIT_S)
        finally:
            ended.set()
            killer.join()
    assert capfd.readouterr().err == ""
    state, reason, _ = ending_of(tmp_path / "live.h5")
    assert state is RunState.INTERRUPTED
    assert "two workers in turn died" in reason
