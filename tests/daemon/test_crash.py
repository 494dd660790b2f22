"""The daemon killed in the middle of its work: nothing moves by itself, and what was recorded is there."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from bscd.acquisition import RunFile, RunState
from bscd.client import Client
from bscd.daemon.documents import JobStatus
from tests.api.serving import ROOT, configuration, idle, progressed, serving
from tests.daemon.small import until
from tests.drivers.gige_rig import require_aravis

SCAN = {"recipe": "bsc-scan", "positions": 7, "step_mm": 4.0, "frames_per_position": 1, "poses": ["face"]}
STEPS, K = 8, 5
FRAMES_A_FLUSH = 11

#: The daemon's look at its devices, and how many are waited for to see that nothing moves.
POLL_S, LOOKS = 0.1, 10


def waited(client, recipe):
    return client.wait(client.submit(recipe).id)


def axes(client):
    """What the axes read now."""
    return {name: device.reading for name, device in client.status().devices.items() if device.kind == "axis"}


def nothing_moves(client):
    """After a restart: at rest, not homed where the device does not know, vented, and it stays so."""
    before = client.status()
    assert before.state.value == "idle"
    assert "vented; nothing moved" in before.reason
    assert before.job is None
    readings = axes(client)
    for device in before.devices.values():
        if device.kind == "axis":
            assert device.homed is False
            assert device.moving is False
    assert before.devices["pressure"].details["set_point_kpa"] == pytest.approx(0.0, abs=1e-3)
    time.sleep(LOOKS * POLL_S)
    assert axes(client) == readings


@pytest.mark.timeout(300)
def test_a_scan_goes_on_at_k_and_a_calibration_is_made_again(tmp_path):
    config = configuration(tmp_path)
    with serving(config) as served, Client(served.url) as client:
        idle(client)
        waited(client, {"recipe": "home"})
        job = client.submit(SCAN)
        assert not progressed(client, job, K).status.ended
        served.kill()
    (path,) = (tmp_path / "data/runs").glob("bsc-scan-*.h5")
    with RunFile(path, crashed=True) as run:
        kept = [frame.data.copy() for frame in run.frames("primary")]
    assert len(kept) >= K - 1  # one more may be on its way

    with serving(config) as served, Client(served.url) as client:
        idle(client)
        nothing_moves(client)
        after = client.job(job.id)
        assert after.status is JobStatus.INTERRUPTED
        assert after.reason == "the daemon ended under it"
        assert after.next_step == len(kept)
        assert after.outputs == {"run": path.stem}
        with RunFile(path) as run:
            assert run.state is RunState.INTERRUPTED
            assert run.verify() is None
        waited(client, {"recipe": "home"})
        client.resume_from(job.id)
        assert client.wait(job.id).figures["frames"] == STEPS
        with RunFile(path) as run:
            assert run.complete
            frames = [frame.data for frame in run.frames("primary")]
        assert len(frames) == STEPS
        assert all(np.array_equal(one, other) for one, other in zip(kept, frames, strict=False))

        reference = waited(client, {**SCAN, "recipe": "reference-scan"}).outputs["run"]
        calibrate = client.submit({"recipe": "calibrate", "reference": reference, "bsc": path.stem})
        assert not progressed(client, calibrate, 1).status.ended
        served.kill()
    with serving(config) as served, Client(served.url) as client:
        idle(client)
        assert client.job(calibrate.id).status is JobStatus.INTERRUPTED
        client.resume_from(calibrate.id)
        assert client.wait(calibrate.id).outputs["calibration"]


@pytest.mark.timeout(200)
def test_what_waited_in_line_waits_for_a_person(tmp_path):
    slow = {"\nspeed_mm_s = 20.0": "\nhomed_at_start = true\nspeed_mm_s = 0.5"}
    config = configuration(tmp_path, 320, slow)
    with serving(config) as served, Client(served.url) as client:
        idle(client)
        moving = client.submit({"recipe": "move", "axis": "jacks", "position": 80.0})
        until(lambda: client.job(moving.id).status is JobStatus.RUNNING, "the move")
        steps = [{"name": "up", "do": {"recipe": "move", "axis": "jacks", "position": 70.5}}]
        queued = client.submit({"recipe": "campaign", "steps": steps})
        served.kill()
    with serving(config) as served, Client(served.url) as client:
        idle(client)
        assert client.job(moving.id).status is JobStatus.INTERRUPTED
        assert client.job(queued.id).status is JobStatus.QUEUED
        assert client.status().queue == (queued.id,)
        new = client.wait(client.submit({"recipe": "move", "axis": "jacks", "position": 69.9}).id)
        assert new.status is JobStatus.DONE
        assert client.job(queued.id).status is JobStatus.QUEUED  # what is asked for now does not set it free
        client.resume(queued.id)
        assert client.wait(queued.id).figures["up"]["jacks_mm"] == pytest.approx(70.5, abs=0.3)


@pytest.mark.timeout(200)
def test_a_campaign_goes_on_at_the_step_that_was_cut_off(tmp_path):
    slow = {"\nspeed_mm_s = 20.0": "\nhomed_at_start = true\nspeed_mm_s = 0.5"}
    config = configuration(tmp_path, 320, slow)
    steps = [
        {"name": name, "do": {"recipe": "move", "axis": "jacks", "position": position}}
        for name, position in {"first": 70.5, "second": 74.0, "third": 73.5}.items()
    ]
    with serving(config) as served, Client(served.url) as client:
        idle(client)
        job = client.submit({"recipe": "campaign", "steps": steps})
        until(lambda: (p := client.job(job.id).progress) is not None and "step 2 of 3" in p.doing, "the second step")
        served.kill()
    with serving(config) as served, Client(served.url) as client:
        idle(client)
        after = client.job(job.id)
        assert (after.status, after.next_step) == (JobStatus.INTERRUPTED, 1)
        assert after.figures["first"]["jacks_mm"] == pytest.approx(70.5, abs=0.3)
        assert client.status().job is None
        client.resume_from(job.id)
        over = client.wait(job.id)
        assert (over.status, over.next_step) == (JobStatus.DONE, 3)
        assert over.figures["third"]["jacks_mm"] == pytest.approx(73.5, abs=0.3)
        assert over.figures["first"] == after.figures["first"]  # it was not done again


@pytest.fixture
def emulated(tmp_path):
    """A rig behind its wires in a process of its own, which goes on when the daemon is killed."""
    require_aravis()
    config = configuration(tmp_path, 320)
    real = tmp_path / "real.toml"
    with subprocess.Popen(
        [Path(sys.executable).with_name("bscd"), "emulate", "--config", config, "--write-config", real],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    ) as process:
        assert process.stdout is not None
        while "serving" not in (line := process.stdout.readline()):
            assert line, "the emulators ended by themselves"
        yield real
        process.terminate()
        process.wait(60.0)


@pytest.mark.own_network
@pytest.mark.timeout(200)
def test_an_inflation_is_recovered_and_the_real_regulator_is_vented(emulated, tmp_path):
    with serving(emulated) as served, Client(served.url) as client:
        idle(client)
        waited(client, {"recipe": "home"})
        job = client.submit(
            {
                "recipe": "inflation",
                "specimen": None,  # a real rig asks for it
                "inflation": {"rest_frames": 5, "ramp_s": 30.0, "hold_s": 10.0, "top_kpa": 10.0, "rest_settle_s": 0.5},
            }
        )
        assert not progressed(client, job, 5 * FRAMES_A_FLUSH).status.ended
        until(lambda: (client.status().pressure_kpa or 0.0) > 0.5, "pressure")
        done = client.job(job.id).progress.done
        readings = axes(client)
        served.kill()
    with serving(emulated) as served, Client(served.url) as client:
        idle(client)
        status = client.status()
        assert "vented; nothing moved" in status.reason
        assert status.devices["pressure"].details["set_point_kpa"] == pytest.approx(0.0, abs=0.01)
        until(lambda: abs(client.status().pressure_kpa) < 0.1, "the membrane's vent")
        assert axes(client) == pytest.approx(readings, abs=1e-3)  # the stages lived on, and were left where they were
        time.sleep(LOOKS * POLL_S)
        assert axes(client) == pytest.approx(readings, abs=1e-3)
        after = client.job(job.id)
        assert after.status is JobStatus.INTERRUPTED
        (path,) = (tmp_path / "data/runs").glob(f"*{job.id}*.h5")
        with RunFile(path) as run:
            assert run.state is RunState.INTERRUPTED
            assert len(run.table()) >= done - 2 * FRAMES_A_FLUSH
            assert run.verify() is None
        assert client.status().job is None
