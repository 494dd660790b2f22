"""The recorder: every frame in the file or in the account, whatever the disk does."""

import os
import shutil
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from bscd.acquisition import RunFile, RunState, RunWriter
from bscd.acquisition.stream import FrameAccount, FrameRing, LiveView, Recorder
from bscd.errors import BscdError
from tests.acquisition.stream.sources import camera, image, record

SHAPE = (64, 80)


class Stream:
    """A run with its ring, recorder and account."""

    def __init__(self, path, slots=16, **writer):
        self.writer = RunWriter(path, title="stream", cameras=camera(SHAPE), **writer)
        self.ring = FrameRing(SHAPE, np.uint8, slots)
        self.account = FrameAccount()
        self.recorder = Recorder(self.writer, self.ring, self.account)

    def publish(self, *numbers):
        for number in numbers:
            self.account.exposed(number, "lost by the camera")
            if not self.ring.publish(number, record(number, SHAPE)):
                self.account.lose(number, "the ring was full")

    def end(self):
        self.recorder.finish(30.0)
        self.ring.close()
        assert self.account.difference(self.writer.frames_written) == ""


@pytest.fixture
def stream(tmp_path):
    made = Stream(tmp_path / "run.h5", flush_every=4)
    yield made
    made.recorder.finish(30.0)
    made.ring.close()
    made.writer.close()


@pytest.mark.parametrize("compression", ["none", "bitshuffle-lz4"])
def test_every_frame_bit_for_bit(tmp_path, compression):
    stream = Stream(tmp_path / "run.h5", flush_every=4, compression=compression)
    live = LiveView(stream.ring)
    stream.recorder.start()
    for number in range(40):
        stream.publish(number)
        stream.recorder.wait_idle(30.0)
    assert live.latest().frame_id == 1039
    stream.end()
    stream.writer.close()
    with RunFile(tmp_path / "run.h5") as run:
        assert run.verify() is None
        read = list(run.frames())
        assert [frame.frame_id for frame in read] == list(range(1000, 1040))
        assert all(np.array_equal(frame.data, image(n, SHAPE)) for n, frame in enumerate(read))


def test_compression_saves_what_the_frames_can_spare(tmp_path):
    sizes = []
    for compression in ("none", "bitshuffle-lz4"):
        path = tmp_path / f"{compression}.h5"
        with RunWriter(path, title="t", cameras=camera((512, 512)), compression=compression) as run:
            for number in range(8):
                run.append(record(number, (512, 512)))
        sizes.append(path.stat().st_size)
    assert sizes[1] < 0.95 * sizes[0]


def test_what_is_not_written_any_more_is_counted_with_the_reason(stream, monkeypatch):
    stream.recorder.start()
    stream.publish(*range(5))
    stream.recorder.wait_idle(30.0)
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=7_000_000))
    stream.publish(5, 6, 7)
    stream.end()
    assert "the disk is full" in str(stream.recorder.failure)
    (loss,) = stream.account.losses
    assert (loss.first, loss.count) == (5, 3)
    assert loss.reason.startswith("not written: ")
    stream.writer.interrupt(str(stream.recorder.failure))
    with RunFile(stream.writer.path) as run:
        assert run.state is RunState.INTERRUPTED
        assert len(run.table()) == 5
        assert run.verify() is None


@pytest.mark.parametrize("gone", ["folder", "file"])
def test_a_folder_or_a_file_that_is_gone_ends_the_writing(tmp_path, gone):
    folder = tmp_path / "runs"
    folder.mkdir()
    stream = Stream(folder / "run.h5")
    stream.recorder.start()
    stream.publish(0)
    stream.recorder.wait_idle(30.0)
    if gone == "folder":
        folder.rename(tmp_path / "elsewhere")
    else:
        (folder / "run.h5").unlink()
    stream.publish(1)
    stream.end()
    said = "its folder can not be reached" if gone == "folder" else "somebody deleted the file"
    assert said in str(stream.recorder.failure)
    stream.writer.interrupt(str(stream.recorder.failure))
    if gone == "folder":
        with RunFile(tmp_path / "elsewhere/run.h5") as run:
            assert (len(run.table()), run.verify()) == (1, None)


def test_frames_that_wait_are_flushed_when_no_more_come(tmp_path):
    stream = Stream(tmp_path / "run.h5", flush_every=100)
    stream.recorder.start()
    stream.publish(0, 1, 2)
    with RunFile(tmp_path / "run.h5") as run:
        deadline_s = time.monotonic() + 30.0
        while len(run.table()) < 3 and time.monotonic() < deadline_s:
            threading.Event().wait(0.05)
        assert len(run.table()) == 3
    stream.end()
    stream.writer.close()


def test_a_disk_that_hangs_is_left_as_it_is(tmp_path):
    stream = Stream(tmp_path / "run.h5")
    held = threading.Event()
    stream.writer.append = lambda frame: held.wait(30.0)
    stream.recorder.start()
    stream.publish(0)
    with pytest.raises(BscdError, match="the disk did not take the last frames"):
        stream.recorder.finish(0.1)
    stream.writer.close()
    with RunFile(tmp_path / "run.h5") as run:
        assert run.state is RunState.RECORDING
    held.set()
    stream.recorder.finish(30.0)
    stream.ring.close()


def test_each_flush_waits_for_the_disk_where_asked(tmp_path, monkeypatch):
    synced = []
    fsync = os.fsync
    monkeypatch.setattr("os.fsync", lambda descriptor: synced.append(fsync(descriptor)))
    with RunWriter(tmp_path / "run.h5", title="t", cameras=camera(SHAPE), flush_every=2, sync=True) as run:
        for number in range(4):
            run.append(record(number, SHAPE))
        assert len(synced) == 2
    with RunWriter(tmp_path / "no.h5", title="t", cameras=camera(SHAPE), flush_every=2) as run:
        for number in range(4):
            run.append(record(number, SHAPE))
        assert len(synced) == 4  # two of closing the first: its last flush, and the end


def test_the_reserve_is_left_free(tmp_path):
    free = shutil.disk_usage(tmp_path).free
    with (
        pytest.raises(BscdError, match="the disk is full"),
        RunWriter(tmp_path / "run.h5", title="t", cameras=camera(SHAPE), reserve_bytes=2 * free) as run,
    ):
        run.append(record(0, SHAPE))
