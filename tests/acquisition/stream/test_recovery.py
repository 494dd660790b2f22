"""SIGKILL at random moments of a recording: every frame older than the flush interval comes back, bit for bit."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from bscd.acquisition import PressureMeta, RunFile, RunState, RunWriter, recover_in_place, recover_into
from bscd.errors import InputError
from bscd.hdf5.superblock import lookup3
from tests.acquisition.run_records import SETTINGS, frames, same
from tests.acquisition.stream.killed_recording import SHAPE
from tests.acquisition.stream.sources import image

ROOT = Path(__file__).resolve().parents[3]
FLUSH_EVERY = 11


class Killer:
    """Recordings that are killed after a while."""

    def __init__(self):
        self._server = subprocess.Popen(
            [sys.executable, "-m", "tests.acquisition.stream.killed_recording"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        assert self._line() == "ready"

    def kill_after(self, path, lasting_s, rate_hz=200.0):
        """How many frames had been written when it was killed."""
        print(path, rate_hz, FLUSH_EVERY, file=self._server.stdin, flush=True)
        pid, written = int(self._line().removeprefix("pid ")), 0
        while not (said := self._line()).startswith("written "):
            assert said == ""
        deadline_s = time.monotonic() + lasting_s
        while (left_s := deadline_s - time.monotonic()) > 0:
            time.sleep(left_s)
        os.kill(pid, signal.SIGKILL)
        while said != "gone":
            if said.startswith("written "):
                written = int(said.split()[1]) + 1
            said = self._line()
        return written

    def close(self):
        self._server.stdin.close()
        assert self._server.wait(30) == 0
        self._server.stdout.close()

    def _line(self):
        return self._server.stdout.readline().strip()


@pytest.fixture(scope="module")
def killer():
    killer = Killer()
    yield killer
    killer.close()


@pytest.fixture(scope="module")
def killed(killer, tmp_path_factory):
    path = tmp_path_factory.mktemp("killed") / "run.h5"
    killer.kill_after(path, 0.2)
    return path


def as_published(records):
    return all(np.array_equal(one.data, image(number, SHAPE)) for number, one in enumerate(records))


@pytest.mark.parametrize("attempt", range(20))
def test_killed_at_a_random_moment(killer, tmp_path, attempt):
    lasting_s = random.Random(attempt).uniform(0.0, 0.4)
    path = tmp_path / "run.h5"
    written = killer.kill_after(path, lasting_s)
    recovery = recover_in_place(path)
    assert recovery.changed
    assert recovery.damage == ""
    assert recovery.frames >= written - FLUSH_EVERY
    with h5py.File(path, "r") as file:  # as any program opens it
        count = int((file["entry/instrument/primary/sequence_number"][:] >= 0).sum())
        data = file["entry/instrument/primary/data"][:count]
    assert count == recovery.frames
    assert all(np.array_equal(one, image(number, SHAPE)) for number, one in enumerate(data))
    with RunFile(path) as run:
        assert run.state is RunState.INTERRUPTED
        assert run.reason == "its writer was killed; recovered"
        assert [frame.frame_id for frame in run.frames()] == list(range(1000, 1000 + count))


def test_in_place_nothing_but_the_mark_changes(killed, tmp_path):
    path = tmp_path / "run.h5"
    shutil.copy(killed, path)
    recover_in_place(path)
    before, after = killed.read_bytes(), path.read_bytes()
    assert len(before) == len(after)
    assert {place for place in range(len(before)) if before[place] != after[place]} <= {
        11,
        *range(28, 36),
        *range(44, 48),
    }
    again = recover_in_place(path)
    assert not again.changed
    assert path.read_bytes() == after


def test_into_a_copy_and_the_run_stays_as_it_is(killed, tmp_path):
    before = killed.read_bytes()
    recovery = recover_into(killed, tmp_path / "copy.h5")
    assert killed.read_bytes() == before
    with RunFile(killed) as run, RunFile(tmp_path / "copy.h5") as copy:
        assert (copy.uuid, copy.header.start_time) == (run.uuid, run.header.start_time)
        assert copy.state is RunState.INTERRUPTED
        assert copy.verify() is None
        assert len(copy.checksum) == 64
        assert np.array_equal(copy.pressure_log()[0], run.pressure_log()[0])
        copied = list(copy.frames())
        assert len(copied) == recovery.frames == len(run.table())
        assert as_published(copied)


def test_a_copy_keeps_every_camera_axis_target_and_event(tmp_path):
    with RunWriter(tmp_path / "run.h5", **SETTINGS, pressure=PressureMeta()) as run:
        run.set_target("jack", 5.0)
        run.event("lamp at 80 %")
        for record in frames(6):
            run.append(record)
        run.interrupt("stopped")
    recover_into(tmp_path / "run.h5", tmp_path / "copy.h5")
    with RunFile(tmp_path / "run.h5") as run, RunFile(tmp_path / "copy.h5") as copy:
        assert all(same(a, b) for a, b in zip(run.frames(), copy.frames(), strict=True))
        assert copy.events == run.events
        assert copy.checksum == run.checksum
        assert copy.reason == "stopped"
        assert copy.targets("jack").tolist() == [5.0] * 6


def test_a_damaged_frame_is_told_and_ends_the_copy(killed, tmp_path):
    path = tmp_path / "run.h5"
    shutil.copy(killed, path)
    place = path.read_bytes().index(image(3, SHAPE).tobytes())
    with path.open("r+b") as file:
        file.seek(place + 1000)
        file.write(b"\0\0")
    assert "frame 3" in recover_in_place(path).damage
    recovery = recover_into(path, tmp_path / "copy.h5")
    assert recovery.frames == 3
    assert "frame 3" in recovery.damage


def test_a_run_that_is_being_written_is_left_alone(tmp_path):
    with RunWriter(tmp_path / "run.h5", **SETTINGS) as run:
        run.append(next(frames(1)))
        before = (tmp_path / "run.h5").read_bytes()
        with pytest.raises(InputError, match=f"is being written by process {os.getpid()}"):
            recover_in_place(tmp_path / "run.h5")
        assert (tmp_path / "run.h5").read_bytes() == before


def test_a_complete_run_needs_nothing(tmp_path):
    with RunWriter(tmp_path / "run.h5", **SETTINGS) as run:
        run.append(next(frames(1)))
    before = (tmp_path / "run.h5").read_bytes()
    recovery = recover_in_place(tmp_path / "run.h5")
    assert (recovery.changed, recovery.frames) == (False, 1)
    assert (tmp_path / "run.h5").read_bytes() == before


def test_first_bytes_that_are_damaged_are_not_made_worse(killed, tmp_path):
    path = tmp_path / "run.h5"
    shutil.copy(killed, path)
    with path.open("r+b") as file:
        file.seek(45)
        file.write(b"\xff")
    before = path.read_bytes()
    with pytest.raises(InputError, match="damaged"):
        recover_in_place(path)
    assert path.read_bytes() == before


def test_the_checksum_is_that_of_its_author():
    """Bob Jenkins' own examples, lookup3.c, driver5."""
    assert lookup3(b"") == 0xDEADBEEF
    assert lookup3(b"Four score and seven years ago") == 0x17770551
