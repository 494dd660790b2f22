"""Runs whose end is missing, as after a copy that broke off: what is left of them comes back, bit for bit."""

import re
from dataclasses import replace

import h5py
import numpy as np
import pytest

from bscd.acquisition import CameraMeta, RunFile, RunState, RunWriter, recover_in_place, recover_into
from bscd.errors import InputError
from drivers.interfaces import PressureReading
from tests.acquisition.run_records import PRESSURE, SETTINGS, frames, same

FRAMES = 2600  # columns go on in further chunks from frame 512 on, and the index of these from frame 2048 on
SIZES = {"primary": 8 * 12, "auxiliary": 6 * 10 * 2}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "run.h5"
    with RunWriter(path, **SETTINGS, pressure=PRESSURE, flush_every=16) as run:
        for number, record in enumerate(frames(FRAMES)):
            run.set_target("jack", 5.0 + number)
            run.log_pressure(PressureReading(0.1 * number, record.host_time_ns))
            if number % 100 == 0:
                run.event(f"frame {number} comes")
            run.append(record)
        run.account(FRAMES, ())
    return path


@pytest.fixture(scope="module")
def ends(whole):
    """Where the bytes of each frame end in the file, ``(N,)``: its image's and those of its row in every column."""
    last = np.zeros((2, FRAMES // 2), np.int64)
    with h5py.File(whole) as file:
        for camera, name in enumerate(SIZES):
            for column in file[f"entry/instrument/{name}"].values():
                if isinstance(column, h5py.Dataset) and column.maxshape[:1] == (None,):
                    row_bytes = SIZES[name] if column.name.endswith("/data") else column.dtype.itemsize
                    for number in range(column.id.get_num_chunks()):
                        chunk = column.id.get_chunk_info(number)
                        first, count = chunk.chunk_offset[0], column.chunks[0]
                        rows = last[camera, first : first + count]
                        np.maximum(rows, chunk.byte_offset + row_bytes * np.arange(1, len(rows) + 1), out=rows)
    return last.T.reshape(-1)


def cut(whole, path, length):
    path.write_bytes(whole.read_bytes()[:length])
    return path


def begins(part, everything):
    return all(np.array_equal(one, other[: len(one)]) for one, other in zip(part, everything, strict=True))


@pytest.mark.parametrize("share", [0.26, 0.4, 0.7, 0.97])
def test_the_frames_before_the_cut_come_back_as_recorded(whole, ends, tmp_path, share):
    length = int(share * whole.stat().st_size)
    path = cut(whole, tmp_path / "cut.h5", length)
    before = path.read_bytes()
    recovery = recover_into(path, tmp_path / "copy.h5")
    assert path.read_bytes() == before
    assert recovery.damage == f"{path}: {whole.stat().st_size - length} bytes of its end are missing"
    there = np.cumprod(ends <= length).sum()
    assert 0 < recovery.frames <= there
    assert recovery.frames >= there - 32  # the index of the last images may be beyond the cut
    with RunFile(whole) as run, RunFile(tmp_path / "copy.h5") as copy:
        assert copy.state is RunState.INTERRUPTED
        assert copy.reason == "it was cut off; recovered into a copy"
        assert repr(copy.header) == repr(run.header)  # its uuid as well; some values are NaN
        assert copy.verify() is None
        records = list(copy.frames())
        assert len(records) == recovery.frames
        assert all(same(one, other) for one, other in zip(records, run.frames(), strict=False))
        assert copy.targets("jack").tolist() == (5.0 + np.arange(len(records))).tolist()
        assert begins(copy.pressure_log(), run.pressure_log())
        assert len(copy.pressure_log()[0]) > 0.9 * len(records)
        assert copy.events == run.events[: len(copy.events)]
        assert copy.frames_acquired is None  # what was counted is not what is here


def test_a_cut_within_a_frame_ends_before_it(tmp_path):
    recorded = [
        replace(record, data=np.random.default_rng(number).integers(0, 256, (200, 300)).astype(np.uint8))
        for number, record in enumerate(record for record in frames(16) if record.camera == "primary")
    ]
    with RunWriter(tmp_path / "run.h5", title="large images", cameras={"primary": CameraMeta(300, 200, 8)}) as run:
        for record in recorded:
            run.append(record)
    with h5py.File(tmp_path / "run.h5") as file:
        place = file["entry/instrument/primary/data"].id.get_chunk_info(4).byte_offset
    path = cut(tmp_path / "run.h5", tmp_path / "cut.h5", place + 30_000)
    assert recover_into(path, tmp_path / "copy.h5").frames == 4
    with RunFile(tmp_path / "copy.h5") as copy:
        assert all(same(one, other) for one, other in zip(copy.frames(), recorded[:4], strict=True))


@pytest.mark.parametrize("length", [1, 47, 48, 100, 3000, 9000, 20_000, 60_000, 120_000, 200_000])
def test_before_the_first_frame_nothing_is_made(whole, ends, tmp_path, length):
    assert length < ends[0]
    path = cut(whole, tmp_path / "cut.h5", length)
    with pytest.raises(
        InputError, match=r"is cut off before the end of its first frame|is damaged|is not an HDF5 file"
    ):
        recover_into(path, tmp_path / "copy.h5")
    assert not (tmp_path / "copy.h5").exists()


def test_opening_one_names_the_command_and_in_place_nothing_is_changed(whole, tmp_path):
    path = cut(whole, tmp_path / "cut.h5", whole.stat().st_size // 2)
    before, command = path.read_bytes(), re.escape(f"bscd recover {path} --out COPY.h5")
    with pytest.raises(InputError, match=f"is cut off, .*{command}"):
        RunFile(path)
    with pytest.raises(InputError, match=f"is cut off, .*{command}"):
        recover_in_place(path)
    assert path.read_bytes() == before
