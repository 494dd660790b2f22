"""Jobs on the twin: their order, their safe points, their endings, and what is refused before anything moves."""

from itertools import pairwise

import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.daemon.documents import JobStatus, RigState
from bscd.daemon.errors import IllegalRequestError, InterlockError, UnknownNameError
from bscd.errors import InputError
from drivers.simulated.faults import Fault
from tests.daemon.small import done, ended, recipe, small_daemon, until

SCAN = {"positions": 3, "step_mm": 8.0, "frames_per_position": 1, "settle_s": 0.0}
#: The corner, then the face at three positions.
STEPS = 6


@pytest.fixture(scope="module")
def homed(tmp_path_factory):
    """In virtual time, homed, for tests that leave it idle."""
    with small_daemon(tmp_path_factory.mktemp("homed")) as daemon:
        done(daemon, "home")
        yield daemon


def readings(daemon):
    return {role: axis.status().position for role, axis in daemon.bench.rig.axes.items()}


def test_an_axis_that_is_not_homed_is_not_moved_but_may_be_homed_before(tmp_path):
    with small_daemon(tmp_path, sensor_px=320) as daemon:
        before = readings(daemon)
        with pytest.raises(InterlockError, match="jacks: not homed; home it first") as refused:
            daemon.submit(recipe("reference-scan", **SCAN), "test")
        assert len(refused.value.problems) == 3
        assert daemon.jobs() == []
        assert readings(daemon) == before
        home = daemon.submit(recipe("home"), "test")
        move = daemon.submit(recipe("move", axis="jacks", position=30.0), "test")
        assert ended(daemon, home).figures.keys() == {"jacks_mm", "translation_mm", "rotation_deg"}
        assert ended(daemon, move).figures["jacks_mm"] == pytest.approx(30.0, abs=0.2)


@pytest.mark.parametrize(
    ("kind", "values", "told"),
    [
        ("move", {"axis": "jacks", "position": 300.0}, "jacks: 300 mm is needed, its limits are 0 to 84 mm"),
        ("reference-scan", {**SCAN, "step_mm": 80.0}, "translation: -30 to 130 mm is needed, its limits are"),
        ("bsc-scan", {**SCAN, "exposure_s": 50.0}, "primary camera: exposure_s = 50 is outside"),
        ("bsc-scan", {**SCAN, "positions": 4}, "must be odd"),
        (
            "inflation",
            {"inflation": {"top_kpa": 40.0}},
            "top_kpa = 40 kPa is outside the pressure source's 0 to 16 kPa",
        ),
        ("inflation", {"calibration": "nothing"}, "calibration 'nothing': there is none of that name"),
        ("inflation", {"inflation": {"ramp_s": 86400.0}}, "the disk has"),
        ("calibrate", {"reference": "a", "bsc": "b"}, "run 'a': there is none of that name; run 'b'"),
        ("measure", {"calibration": "a", "run": "b"}, "calibration 'a': there is none"),
    ],
)
def test_a_whole_recipe_is_looked_at_before_anything_moves(homed, kind, values, told):
    before, known = readings(homed), len(homed.jobs())
    looked = homed.validate(recipe(kind, **values))
    assert not looked.ok
    assert told in "; ".join(looked.problems)
    with pytest.raises(InterlockError, match="refused, nothing moved"):
        homed.submit(recipe(kind, **values), "test")
    assert readings(homed) == before
    assert len(homed.jobs()) == known


def test_validation_tells_limits_frames_disk_and_time(homed):
    looked = homed.validate(recipe("reference-scan", **SCAN))
    assert looked.ok
    assert looked.frames == STEPS * 2
    assert looked.disk_bytes == STEPS * 2 * 1280 * 1024
    assert looked.duration_s > 0.0
    assert looked.limits["translation"]["least"] == 42.0
    assert looked.limits["translation"]["greatest"] == 58.0
    assert looked.limits["rotation"] == {"least": 0.0, "greatest": 45.0, "low_limit": -180.0, "high_limit": 180.0}


def test_the_disks_reserve_is_kept(tmp_path):
    refused = pytest.raises(InterlockError, match="beyond the reserve of 1000000000 MB")
    with small_daemon(tmp_path, sensor_px=320, reserve_mb=1e9) as daemon, refused:
        daemon.submit(recipe("home"), "test")


def test_a_scan_pauses_at_a_position_goes_on_and_keeps_every_frame(homed):
    seen = []
    job = homed.submit(recipe("bsc-scan", **SCAN), "test")
    until(lambda: (p := homed.job(job.id).progress) is not None and p.done >= 1, "the first position")
    assert homed.states.state is RigState.RUNNING
    homed.pause_job(job.id, "test")
    until(lambda: homed.job(job.id).status is JobStatus.PAUSED, "the safe point")
    assert homed.states.state is RigState.PAUSED
    at_rest = readings(homed)
    assert not any(axis.status().moving for axis in homed.bench.rig.axes.values())
    with pytest.raises(IllegalRequestError) as refused:
        homed.pause_job(job.id, "test")
    assert refused.value.allowed == ("resume", "stop", "abort")
    seen.append(homed.job(job.id).progress.done)
    assert readings(homed) == at_rest
    homed.resume_job(job.id, "test")
    over = ended(homed, job)
    assert over.status is JobStatus.DONE
    assert over.figures["frames"] == STEPS
    assert seen[0] < STEPS
    with RunFile(homed.files.path("run", over.outputs["run"])) as run:
        assert run.complete
        assert run.verify() is None


def test_a_stopped_scan_goes_on_at_its_position_and_what_it_had_stays(homed):
    job = homed.submit(recipe("bsc-scan", **SCAN), "test")
    until(lambda: (p := homed.job(job.id).progress) is not None and p.done >= 1, "the first position")
    homed.pause_job(job.id, "test")
    homed.stop_job(job.id, "test")
    over = ended(homed, job)
    assert over.status is JobStatus.STOPPED
    until(lambda: homed.states.state is RigState.IDLE, "a rig at rest")
    assert 1 <= over.next_step < STEPS
    path = homed.files.path("run", over.outputs["run"])
    with RunFile(path) as run:
        before = [frame.data.copy() for frame in run.frames("primary")]
    assert len(before) == over.next_step
    again = homed.resume_from(job.id, "test")
    assert again.id == job.id
    over = ended(homed, job)
    assert over.status is JobStatus.DONE, over.reason
    with RunFile(path) as run:
        after = [frame.data for frame in run.frames("primary")]
        assert run.complete
    assert len(after) == STEPS
    assert all(np.array_equal(one, other) for one, other in zip(before, after, strict=False))
    with pytest.raises(IllegalRequestError, match="has not ended early"):
        homed.resume_from(job.id, "test")


def test_the_same_key_is_the_same_job(homed):
    first = homed.submit(recipe("home"), "test", "key-1")
    again = homed.submit(recipe("home"), "test", "key-1")
    assert again.id == first.id
    with pytest.raises(InputError, match="key-1: was used for another recipe"):
        homed.submit(recipe("home", again=True), "test", "key-1")
    ended(homed, first)


def test_jobs_are_done_in_their_order_one_at_a_time(homed):
    jobs = [homed.submit(recipe("move", axis="jacks", position=10.0 + n), "test") for n in range(6)]
    over = [ended(homed, job) for job in jobs]
    for earlier, later in pairwise(over):
        assert earlier.ended_at <= later.started_at
    assert [round(job.figures["jacks_mm"]) for job in over] == [10, 11, 12, 13, 14, 15]


def test_an_inflation_is_measured_live_and_vented(homed, tmp_path):
    job = done(
        homed,
        "inflation",
        inflation={"rest_frames": 3, "ramp_s": 0.5, "hold_s": 0.3, "top_kpa": 2.0},
        compression="bitshuffle-lz4",
    )
    assert job.figures["ending"] == "completed"
    assert job.figures["frames"] == 3 + round(0.8 * 11)
    assert job.figures["lost_frames"] == 0
    assert homed.bench.rig.pressure.set_point_kpa() == 0.0
    with RunFile(homed.files.path("run", job.outputs["run"])) as run:
        assert run.verify() is None
        assert "[daemon]" in run.config_text


def test_a_job_that_is_not_there(homed):
    for call in (homed.job, lambda job: homed.stop_job(job, "test"), lambda job: homed.resume_from(job, "test")):
        with pytest.raises(UnknownNameError, match="there is none of that name"):
            call("nothing")


def test_no_more_than_the_limit_wait(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, virtual=False, attended=True, queue_limit=2) as daemon:
        first = daemon.submit(recipe("home", prompt="clear?"), "test")
        until(lambda: daemon.job(first.id).status is JobStatus.WAITING, "the question")
        waiting = [daemon.submit(recipe("home"), "test") for _ in range(2)]
        with pytest.raises(IllegalRequestError, match="2 jobs wait already"):
            daemon.submit(recipe("home"), "test")
        assert daemon.status().queue == tuple(job.id for job in waiting)
        assert daemon.stop_job(waiting[0].id, "test").status is JobStatus.STOPPED
        assert daemon.status().queue == (waiting[1].id,)
        daemon.abort_job(waiting[1].id, "test", "no more")
        assert daemon.job(waiting[1].id).reason == "aborted by test: no more"
        daemon.stop_job(first.id, "test")
        assert ended(daemon, first).status is JobStatus.STOPPED


def test_the_operator_is_asked_and_the_job_waits(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, virtual=False, attended=True) as daemon:
        job = daemon.submit(recipe("home", prompt="hands off?"), "test")
        until(lambda: daemon.job(job.id).prompt is not None, "the question")
        waiting = daemon.job(job.id)
        assert (waiting.status, waiting.prompt.text) == (JobStatus.WAITING, "hands off?")
        assert not any(axis.status().homed for axis in daemon.bench.rig.axes.values())
        with pytest.raises(UnknownNameError, match="question 99: is not open"):
            daemon.confirm(job.id, 99, "test")
        daemon.confirm(job.id, waiting.prompt.id, "test")
        over = ended(daemon, job)
        assert (over.status, over.prompt) == (JobStatus.DONE, None)
        with pytest.raises(IllegalRequestError, match="asks nothing"):
            daemon.confirm(job.id, waiting.prompt.id, "test")


def test_nobody_who_confirms_ends_the_job(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, virtual=False, attended=True, confirm_timeout_s=0.2) as daemon:
        job = ended(daemon, daemon.submit(recipe("home", prompt="hands off?"), "test"))
        assert job.status is JobStatus.FAILED
        assert "nobody confirmed in 0.2 s: hands off?" in job.reason
        until(lambda: daemon.states.state is RigState.IDLE, "a rig at rest")


def test_an_abort_stops_what_moves_and_vents(tmp_path):
    text = {"\nspeed_mm_s = 20.0": "\nhomed_at_start = true\nspeed_mm_s = 0.5"}
    with small_daemon(tmp_path, sensor_px=320, virtual=False, changes=text) as daemon:
        daemon.bench.rig.pressure.set_pressure(5.0)
        job = daemon.submit(recipe("move", axis="jacks", position=80.0), "test")
        until(lambda: daemon.bench.rig.jacks.status().moving, "the move")
        daemon.abort_job(job.id, "anna", "wrong membrane")
        over = ended(daemon, job)
        assert over.status is JobStatus.ABORTED
        assert over.reason.startswith("aborted by anna: wrong membrane")
        assert not daemon.bench.rig.jacks.status().moving
        assert daemon.bench.rig.jacks.status().position < 80.0
        assert daemon.bench.rig.pressure.set_point_kpa() == 0.0
        until(lambda: daemon.states.state is RigState.IDLE, "a rig at rest")


def test_a_device_that_is_lost_is_a_fault_and_connecting_mends_it(tmp_path):
    with small_daemon(tmp_path, sensor_px=320) as daemon:
        done(daemon, "home")
        daemon.bench.drivers["jacks"].close()
        until(lambda: daemon.states.state is RigState.FAULT, "the loss is noticed")
        assert "jacks" in daemon.states.reason
        assert daemon.ready()[0] is False
        assert daemon.live()[0] is True
        with pytest.raises(IllegalRequestError) as refused:
            daemon.submit(recipe("home"), "test")
        assert refused.value.state == "fault"
        assert "connect" in refused.value.allowed
        daemon.connect("test")
        assert daemon.states.state is RigState.IDLE


def test_a_device_that_fails_in_a_job_ends_it_with_its_reason(tmp_path):
    with small_daemon(tmp_path, sensor_px=320) as daemon:
        done(daemon, "home")
        daemon.bench.drivers["jacks"].faults.inject(Fault.STALLED_MOVE, count=1)
        job = ended(daemon, daemon.submit(recipe("move", axis="jacks", position=50.0), "test"))
        assert job.status is JobStatus.FAILED
        assert "jacks" in job.reason
        assert not daemon.bench.rig.jacks.status().moving


def test_the_desk_works_beside_the_bench_also_without_a_rig(tmp_path):
    with small_daemon(tmp_path, connected=False) as daemon:
        with pytest.raises(IllegalRequestError, match="no job can start now: the state is offline"):
            daemon.submit(recipe("home"), "test")
        for name in ("a", "b"):
            daemon.files.new("run", name).write_text("no run")
        job = ended(daemon, daemon.submit(recipe("calibrate", reference="a", bsc="b"), "test"))
        assert job.status is JobStatus.FAILED
        assert "is not an HDF5 file" in job.reason
        assert daemon.states.state is RigState.OFFLINE


def test_a_campaign_names_what_its_steps_made_and_goes_on_after_a_failure(tmp_path):
    steps = [
        {"name": "home", "do": {"recipe": "home"}},
        {"name": "up", "do": {"recipe": "move", "axis": "jacks", "position": 40.0}},
        {
            "name": "inflation",
            "do": {
                "recipe": "inflation",
                "inflation": {"rest_frames": 2, "ramp_s": 0.3, "hold_s": 0.2, "top_kpa": 1.0},
            },
        },
        {"name": "down", "do": {"recipe": "move", "axis": "jacks", "position": 10.0}},
    ]
    with small_daemon(tmp_path, sensor_px=320) as daemon:
        with pytest.raises(InterlockError, match=r"step 2 \(bad\): step home makes no run"):
            bad = {"name": "bad", "do": {"recipe": "measure", "calibration": "c", "run": "home"}}
            daemon.submit(recipe("campaign", steps=[steps[0], bad]), "test")
        daemon.bench.drivers["jacks"].faults.inject(Fault.STALLED_MOVE, count=1)
        job = ended(daemon, daemon.submit(recipe("campaign", steps=steps), "test"))
        assert job.status is JobStatus.FAILED
        assert job.next_step in (0, 1)
        done(daemon, "home", again=True)
        daemon.resume_from(job.id, "test")
        job = ended(daemon, job)
        assert job.status is JobStatus.DONE, job.reason
        assert job.next_step == 4
        assert job.outputs == {"inflation.run": f"{job.id}-inflation"}
        assert set(job.figures) >= {"up", "inflation", "down"}
        assert round(daemon.bench.rig.jacks.status().position) == 10
