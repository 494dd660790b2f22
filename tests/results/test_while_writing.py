"""Readers in other processes while results are written, and what is left when the writer is killed."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from bscd.hdf5 import FileState
from bscd.results import ResultsFile, ResultsWriter
from tests.results.measured import frames, header, same

ROOT = Path(__file__).resolve().parents[2]

READER = """
import sys
import numpy as np
from bscd.results import ResultsFile
results = ResultsFile(sys.argv[1])
print("ready", flush=True)
for line in sys.stdin:
    found = list(results.frames())
    print(results.state, len(found), [float(np.nansum(f.xyz_mm)) for f in found], results.verify(), flush=True)
"""

KILLED_WRITER = """
import sys
from bscd.results import ResultsWriter
from tests.results.measured import frames, header
results = ResultsWriter(sys.argv[1], header(), flush_every=4)
for frame in frames(10):
    results.append(frame)
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


def test_another_process_follows_the_results_frame_by_frame(tmp_path):
    path, measured = tmp_path / "r.h5", list(frames(5))
    with ResultsWriter(path, header(), flush_every=2) as results, process(READER, path) as reader:
        assert reader.stdin is not None
        assert reader.stdout is not None
        assert reader.stdout.readline() == "ready\n"
        for count in range(1, 6):
            results.append(measured[count - 1])
            seen = measured[: count - count % 2]  # what has been flushed
            reader.stdin.write("\n")
            reader.stdin.flush()
            told = reader.stdout.readline()
            assert told == f"recording {len(seen)} {[float(np.nansum(frame.xyz_mm)) for frame in seen]} None\n"
        results.close()
        reader.stdin.write("\n")
        reader.stdin.flush()
        assert reader.stdout.readline().startswith("complete 5 ")
        reader.stdin.close()
        assert reader.wait(30) == 0


def test_after_a_kill_every_flushed_frame_is_there(tmp_path):
    path = tmp_path / "r.h5"
    with process(KILLED_WRITER, path) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "written\n"
        writer.send_signal(signal.SIGKILL)
        writer.wait(30)
    with ResultsFile(path) as results:
        read = list(results.frames())
        assert results.state is FileState.RECORDING
        assert results.checksum == ""
        assert results.verify() is None
    assert len(read) >= 8
    assert all(same(a, b) for a, b in zip(frames(10), read, strict=False))


@pytest.mark.parametrize("left", ["xyz_mm", "right_px", "time_s", "frame_number"])
def test_half_a_frame_does_not_count(tmp_path, left):
    """What a crash between the two flushes leaves: some of the last frame's numbers."""
    path = tmp_path / "r.h5"
    with ResultsWriter(path, header()) as results:
        for frame in frames(3):
            results.append(frame)
    with h5py.File(path, "r+") as file:
        file[f"entry/data/{left}"].resize(2, axis=0)
    with ResultsFile(path) as results:
        assert len(results) == 2
        assert same(results.frame(1), list(frames(3))[1])
        assert results.array("strain").shape == (2, 20, 3)
