"""Runs that a killed daemon left: readable at once, read through when the rig is safe."""

import os
import signal
import subprocess
import sys
import threading

import h5py
import pytest

from bscd.acquisition import RunFile, RunState
from bscd.daemon.documents import JobDocument, JobStatus, RigState
from bscd.daemon.errors import IllegalRequestError
from bscd.daemon.jobs import utc_now
from bscd.daemon.journal import Journal
from tests.daemon.small import recipe, small_daemon, until

JOB = "20260301-120000-0a1b"

KILLED = """
import os, signal, sys
from bscd.acquisition import RunWriter
from tests.acquisition.run_records import SETTINGS, frames
writer = RunWriter(sys.argv[1], **SETTINGS, flush_every=4)
for record in frames(12):
    writer.append(record)
os.kill(os.getpid(), signal.SIGKILL)
"""


def crashed(folder, status):
    """What a daemon leaves that was killed in an inflation, or (then it is interrupted) in its next start."""
    path = folder / f"data/runs/inflation-{JOB}.h5"
    path.parent.mkdir(parents=True)
    ended = subprocess.run([sys.executable, "-c", KILLED, path], env=os.environ | {"PYTHONPATH": "."}, check=False)
    assert ended.returncode == -signal.SIGKILL
    job = JobDocument(
        id=JOB,
        recipe=recipe("inflation"),
        place="bench",
        status=status,
        operator="anna",
        created_at=utc_now(),
    )
    journal = Journal(folder / "data/journal.sqlite")
    journal.save(job)
    journal.close()
    return path


@pytest.mark.parametrize("status", [JobStatus.RUNNING, JobStatus.INTERRUPTED])
def test_a_run_is_readable_after_the_start_also_when_that_was_cut_short_before(tmp_path, status):
    path = crashed(tmp_path, status)
    with small_daemon(tmp_path, sensor_px=320, connected=False) as daemon:
        with RunFile(path) as run:
            assert run.state is RunState.INTERRUPTED
            assert len(run.table()) == 12
        job = daemon.job(JOB)
        assert job.status is JobStatus.INTERRUPTED
        assert job.warnings == (f"{path.stem}: its 12 frames were recovered",)
        until(lambda: not daemon.run_check.jobs, "the check")
        assert daemon.job(JOB).warnings == job.warnings


def test_damage_is_found_and_told(tmp_path):
    path = crashed(tmp_path, JobStatus.RUNNING)
    with RunFile(path, crashed=True) as run:
        image = next(iter(run.frames("primary"))).data.tobytes()
    with path.open("r+b") as file:
        file.seek(path.read_bytes().index(image))
        file.write(b"\x00\xff")
    with small_daemon(tmp_path, sensor_px=320, connected=False) as daemon:
        until(lambda: len(daemon.job(JOB).warnings) == 2, "the warning")
        assert "frame 0 (primary camera, frame id 100) is not what was recorded" in daemon.job(JOB).warnings[1]


def test_the_rig_is_vented_and_ready_while_a_run_is_read_through(tmp_path, monkeypatch):
    crashed(tmp_path, JobStatus.RUNNING)
    reading, go = threading.Event(), threading.Event()
    verify = RunFile.verify

    def slowly(self, stop=lambda: False):
        reading.set()
        while not (go.wait(0.05) or stop()):
            pass
        return verify(self, stop)

    monkeypatch.setattr(RunFile, "verify", slowly)
    with small_daemon(tmp_path, sensor_px=320, connected=False) as daemon:
        assert reading.wait(30.0)
        daemon.connect("test")
        assert daemon.states.state is RigState.IDLE
        with pytest.raises(IllegalRequestError, match="its recovered run is being read through"):
            daemon.resume_from(JOB, "test")
        go.set()
        until(lambda: not daemon.run_check.jobs, "the check")
    go.clear()
    with small_daemon(tmp_path, sensor_px=320, connected=False) as daemon:
        assert not daemon.run_check.jobs  # it is recovered, and read once


def test_a_file_that_is_no_run_keeps_no_daemon_from_starting(tmp_path):
    (tmp_path / "data/runs").mkdir(parents=True)
    (tmp_path / f"data/runs/inflation-{JOB}.h5").write_text("no run")
    with h5py.File(tmp_path / f"data/runs/bsc-scan-{JOB[:-1]}c.h5", "w"):
        pass
    with small_daemon(tmp_path, sensor_px=320, connected=False) as daemon:
        assert daemon.jobs() == []
