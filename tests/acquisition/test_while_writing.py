"""Readers in other processes while a run is written, and what is left when the writer is killed."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bscd.acquisition import RunFile, RunState, RunWriter, recover_in_place
from bscd.errors import InputError
from tests.acquisition.run_records import SETTINGS, frames, same

ROOT = Path(__file__).resolve().parents[2]

READER = """
import sys
from bscd.acquisition import RunFile
run = RunFile(sys.argv[1])
print("ready", flush=True)
for line in sys.stdin:
    frames = list(run.frames())
    print(run.state, len(frames), sum(int(f.data.sum()) for f in frames), run.verify(), flush=True)
"""

KILLED_WRITER = """
import sys
from bscd.acquisition import RunWriter
from tests.acquisition.run_records import SETTINGS, frames
run = RunWriter(sys.argv[1], **SETTINGS, flush_every=4)
for record in frames(10):
    run.append(record)
print("written", flush=True)
sys.stdin.read()
"""


def process(code: str, path: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", code, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )


def test_another_process_follows_the_run_frame_by_frame(tmp_path):
    path, recorded = tmp_path / "run.h5", list(frames(6))
    with RunWriter(path, **SETTINGS, flush_every=2) as run, process(READER, path) as reader:
        assert reader.stdin is not None
        assert reader.stdout is not None
        assert reader.stdout.readline() == "ready\n"
        for count in range(1, 7):
            run.append(recorded[count - 1])
            seen = count - count % 2  # what has been flushed
            total = sum(int(record.data.sum()) for record in recorded[:seen])
            reader.stdin.write("\n")
            reader.stdin.flush()
            assert reader.stdout.readline() == f"recording {seen} {total} None\n"
        run.close()
        reader.stdin.write("\n")
        reader.stdin.flush()
        assert reader.stdout.readline().startswith("complete 6 ")
        reader.stdin.close()
        assert reader.wait(30) == 0


@pytest.fixture
def killed(tmp_path):
    """A run whose writer was killed after ten frames, eight of them flushed."""
    path = tmp_path / "run.h5"
    with process(KILLED_WRITER, path) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "written\n"
        writer.send_signal(signal.SIGKILL)
        writer.wait(30)
    return path


def test_after_a_kill_every_flushed_frame_is_there(killed):
    with RunFile(killed) as run:
        read = list(run.frames())
        assert run.state is RunState.RECORDING
        assert not run.complete
        assert run.checksum == ""
        assert run.verify() is None
    assert len(read) >= 8
    assert all(same(a, b) for a, b in zip(frames(10), read, strict=False))


def test_a_recovered_run_goes_on_and_what_it_has_stays(killed):
    recover_in_place(killed)
    recorded = list(frames(12))
    with RunWriter.reopen(killed) as writer:
        had = writer.frames_written
        assert had >= 8
        for record in recorded[had:]:
            writer.append(record)
    with RunFile(killed) as run:
        assert run.complete
        assert run.verify() is None
        assert all(same(a, b) for a, b in zip(recorded, run.frames(), strict=True))


def test_a_run_whose_writer_was_killed_is_not_written_on(killed):
    before = killed.read_bytes()
    with pytest.raises(
        InputError, match="its writer crashed; its frames can be read, by any program after bscd recover"
    ):
        RunWriter.reopen(killed)
    assert killed.read_bytes() == before


def test_the_mean_of_a_growing_run_counts_what_is_flushed(tmp_path):
    path, recorded = tmp_path / "run.h5", [f for f in frames(4) if f.camera == "primary"]
    with RunWriter(path, **SETTINGS) as run, RunFile(path) as reader:
        run.append(recorded[0])
        assert [group.count for group in reader.groups()] == [1]
        run.append(recorded[1])
        (group,) = reader.groups()
        np.testing.assert_allclose(group.data, (recorded[0].data / 2.0 + recorded[1].data / 2.0), atol=1e-5)
