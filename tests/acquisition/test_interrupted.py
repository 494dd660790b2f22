"""Runs that end early, and going on with them."""

import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from bscd.acquisition import FrameRecord, RunFile, RunState, RunWriter
from bscd.errors import BscdError, InputError
from drivers.interfaces import PressureReading
from tests.acquisition.run_records import PRESSURE, SETTINGS, frames, same


def interrupted(path, count=6):
    with pytest.raises(RuntimeError, match="lamp"), RunWriter(path, **SETTINGS, flush_every=4) as run:
        for record in frames(count):
            run.append(record)
        raise RuntimeError("the lamp went out")
    return path


def chunk_places(path):
    """Where each image lies in the file."""
    with h5py.File(path) as file:
        return {
            name: [file[f"entry/instrument/{name}/data"].id.get_chunk_info(k).byte_offset for k in range(3)]
            for name in ("primary", "auxiliary")
        }


def test_an_exception_leaves_a_readable_run_with_the_reason(tmp_path):
    with RunFile(interrupted(tmp_path / "run.h5")) as run:
        assert run.state is RunState.INTERRUPTED
        assert not run.complete
        assert run.reason == "the lamp went out"
        assert all(same(a, b) for a, b in zip(frames(6), run.frames(), strict=True))
        assert run.verify() is None
        assert len(run.checksum) == 64


def test_a_reason_longer_than_its_place_is_cut_between_characters(tmp_path):
    with RunWriter(tmp_path / "run.h5", **SETTINGS) as run:
        run.interrupt("x" + "ä" * 600)
    with RunFile(tmp_path / "run.h5") as run:
        assert run.reason == "x" + "ä" * 255


def test_going_on_leaves_earlier_frames_where_and_as_they_were(tmp_path):
    path = interrupted(tmp_path / "run.h5")
    with RunFile(path) as run:
        uuid = run.uuid
    places, before = chunk_places(path), path.read_bytes()
    with RunWriter.reopen(path) as run:
        assert run.frames_written == 6
        assert run.uuid == uuid
        for record in list(frames(12))[6:]:
            run.append(record)
    after = path.read_bytes()
    sizes = {"primary": 8 * 12, "auxiliary": 6 * 10 * 2}
    assert chunk_places(path) == places
    for name, offsets in places.items():
        for offset in offsets:
            assert after[offset : offset + sizes[name]] == before[offset : offset + sizes[name]]
    with RunFile(path) as run:
        assert run.complete
        assert run.reason == ""
        assert run.uuid == uuid
        assert all(same(a, b) for a, b in zip(frames(12), run.frames(), strict=True))
        assert run.verify() is None
        assert [event.text for event in run.events] == ["recording goes on"]


def test_a_run_in_two_parts_has_the_checksum_of_one_in_one_part(tmp_path):
    with RunWriter(tmp_path / "whole.h5", **SETTINGS) as run:
        for record in frames(9):
            run.append(record)
    path = interrupted(tmp_path / "parts.h5")
    with RunWriter.reopen(path, flush_every=2) as run:
        for record in list(frames(9))[6:]:
            run.append(record)
    with RunFile(tmp_path / "whole.h5") as whole, RunFile(path) as parts:
        assert whole.checksum == parts.checksum
        assert np.array_equal(whole.table()["sequence_number"], parts.table()["sequence_number"])


def test_the_pressure_log_goes_on_too(tmp_path):
    path, image = tmp_path / "run.h5", np.zeros((8, 12), np.uint8)
    with RunWriter(path, **SETTINGS, pressure=PRESSURE) as run:
        run.log_pressure(PressureReading(1.0, 1000))
        run.append(FrameRecord("primary", "inflation", image, 0, host_time_ns=1000))
        run.interrupt("stopped")
    with RunWriter.reopen(path) as run:
        run.log_pressure(PressureReading(2.0, 2000))
        run.append(FrameRecord("primary", "inflation", image, 1, host_time_ns=1500))
    with RunFile(path) as run:
        assert run.table()["pressure_kpa"].tolist() == [1.0, 1.5]
        assert run.verify() is None
    with h5py.File(path) as file:
        assert file["entry/instrument/pressure/value"][:].tolist() == [1.0, 1.5]


def test_frames_without_their_mark_do_not_count_and_are_replaced(tmp_path):
    """What a crash between the two flushes leaves: an image and half its metadata."""
    path = interrupted(tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        primary = file["entry/instrument/primary"]
        primary["data"].resize(5, axis=0)
        primary["y_mm"].resize(4, axis=0)
    with RunFile(path) as run:
        assert len(list(run.frames())) == 6
    with RunWriter.reopen(path) as run:
        for record in list(frames(8))[6:]:
            run.append(record)
    with RunFile(path) as run:
        assert all(same(a, b) for a, b in zip(frames(8), run.frames(), strict=True))
        assert run.verify() is None


def test_frames_after_a_gap_do_not_count(tmp_path):
    """A crash can keep the later mark of one camera and lose the earlier one of the other."""
    path = interrupted(tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        file["entry/instrument/auxiliary/sequence_number"][1] = -1  # frame 3 of the run
    with RunFile(path) as run:
        assert run.table()["sequence_number"].tolist() == [0, 1, 2]


def test_a_complete_run_is_never_written_on(tmp_path):
    path = tmp_path / "run.h5"
    with RunWriter(path, **SETTINGS) as run:
        run.append(next(frames(1)))
    before = path.read_bytes()
    with pytest.raises(InputError, match="is complete; record into a new file"):
        RunWriter.reopen(path)
    assert path.read_bytes() == before


def test_a_run_that_ended_takes_no_more(tmp_path):
    with RunWriter(tmp_path / "run.h5", **SETTINGS) as run:
        run.close()
        with pytest.raises(BscdError, match="has ended"):
            run.append(next(frames(1)))
        run.interrupt("too late")
    with RunFile(tmp_path / "run.h5") as run:
        assert run.complete


def test_a_disk_that_fills_up_ends_the_run_while_it_can_still_be_closed(tmp_path, monkeypatch):
    path, recorded = tmp_path / "run.h5", list(frames(6))
    with (
        pytest.raises(BscdError, match=r"the disk is full \(7 MB left\).*make room"),
        RunWriter(path, **SETTINGS) as run,
    ):
        for record in recorded[:4]:
            run.append(record)
        monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=7_000_000))
        run.append(recorded[4])
    monkeypatch.undo()
    with RunWriter.reopen(path) as run:
        for record in recorded[4:]:
            run.append(record)
    with RunFile(path) as run:
        assert all(same(a, b) for a, b in zip(recorded, run.frames(), strict=True))


FILLS_THE_DISK = """
import gc, os, resource, sys
from dataclasses import replace
from bscd.acquisition import RunFile, RunWriter
from bscd.errors import BscdError
from tests.acquisition.run_records import SETTINGS, frames
from bscd.hdf5 import growing
path, record = sys.argv[1], next(frames(1))
_, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
let_go = growing.abandon

def abandon(file):  # a full disk does not limit memory, as this test's limit does
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    let_go(file)

growing.abandon = abandon
try:
    with RunWriter(path, **SETTINGS) as run:
        run.append(record)
        resource.setrlimit(resource.RLIMIT_FSIZE, (os.stat(path).st_size + 20_000, hard))
        for number in range(10_000):
            run.append(replace(record, frame_id=number))
except BscdError as error:
    print(error)
del run
gc.collect()
with RunFile(path) as run:
    print(run.state, len(list(run.frames())), run.verify())
"""


def test_a_write_that_fails_is_told_in_one_sentence_and_what_was_flushed_stays(tmp_path):
    """In a process of its own, which must survive it: HDF5 crashes at closing a file it could not write."""
    done = subprocess.run(
        [sys.executable, "-c", FILLS_THE_DISK, tmp_path / "run.h5"],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=Path(__file__).resolve().parents[2],
    )
    assert (done.returncode, done.stderr) == (0, "")
    told, left = done.stdout.splitlines()
    assert re.search(r"writing .* failed \(File too large\); look whether the disk is full", told)
    state, count, difference = left.split(" ", 2)
    assert (state, difference) == ("recording", "None")
    assert int(count) > 50
