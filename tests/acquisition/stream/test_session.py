"""A stream into a run: what is told while the disk falls behind, and that no run hides what it lacks."""

import threading
from datetime import UTC, datetime, timedelta

import pytest

from bscd.acquisition import FrameLoss, RunFile, RunState, RunWriter
from bscd.acquisition.stream import StreamSession
from bscd.acquisition.stream.session import RING_FULL
from bscd.errors import BscdError
from tests.acquisition.stream.sources import camera, record

SHAPE, BEGUN = (64, 80), datetime(2026, 1, 1, tzinfo=UTC)


class Disk:
    """A run whose disk takes a frame only while it is not held, and whose clock stands still until it is turned."""

    def __init__(self, path, monkeypatch):
        self.path, self.free, self.seconds = path, threading.Event(), 0
        self.writer = RunWriter(path, title="t", cameras=camera(SHAPE), now=self._now)
        append = self.writer.append

        def held(frame):
            assert self.free.wait(30.0)
            append(frame)

        monkeypatch.setattr(self.writer, "append", held)

    def session(self, slots=16):
        return StreamSession(self.writer, camera(SHAPE)["primary"], slots=slots)

    def events(self):
        with RunFile(self.path) as run:
            return [(round((datetime.fromisoformat(at) - BEGUN).total_seconds()), text) for at, text in _timed(run)]

    def _now(self):
        return BEGUN + timedelta(seconds=self.seconds)


def _timed(run):
    return [(event.time, event.text) for event in run.events]


@pytest.fixture
def disk(tmp_path, monkeypatch):
    return Disk(tmp_path / "run.h5", monkeypatch)


def publish(disk, session, *numbers):
    for number in numbers:
        disk.seconds = number
        session.publish(number, record(number, SHAPE), "lost by the camera")


def test_a_disk_that_falls_behind_is_told_at_once_and_each_loss_with_it(disk):
    with disk.writer, disk.session() as session:
        publish(disk, session, *range(11))
        assert session.trouble == ""
        publish(disk, session, 11)
        assert session.trouble == "the disk falls behind, 12 of 16 buffers in use"
        publish(disk, session, *range(12, 17))
        assert session.trouble == "the disk falls behind, 16 of 16 buffers in use, 1 frame lost"
        publish(disk, session, *range(17, 20))
        assert session.trouble.endswith(", 4 frames lost")
        disk.free.set()
        session.recorder.wait_idle(30.0)
        publish(disk, session, 20, 21)
        assert session.trouble == "4 frames lost"
    assert disk.events() == [
        (11, "the disk falls behind: 12 of 16 buffers in use"),
        (16, f"4 frames lost before frame id 1020: {RING_FULL}"),
        (20, "the disk has caught up"),
    ]
    with RunFile(disk.path) as run:
        assert (run.frames_acquired, run.losses) == (22, (FrameLoss(16, 4, RING_FULL),))
        assert [frame.frame_id for frame in run.frames()] == [*range(1000, 1016), 1020, 1021]


def test_one_that_catches_up_after_the_last_frame(disk):
    with disk.writer, disk.session() as session:
        publish(disk, session, *range(18))
        disk.seconds = 30
        disk.free.set()
    assert disk.events() == [
        (11, "the disk falls behind: 12 of 16 buffers in use"),
        (16, f"2 frames lost at the end: {RING_FULL}"),
        (30, "the disk has caught up"),
    ]


def test_a_run_whose_account_does_not_close_says_that_it_is_incomplete(disk):
    """An exposure that was counted, and whose frame went nowhere."""
    disk.free.set()
    why = "the run is incomplete, 3 exposures, but 2 frames written and 0 counted as lost"
    with pytest.raises(BscdError, match=why), disk.writer, disk.session() as session:
        publish(disk, session, 0, 1)
        session.account.exposed(2, "")
    with RunFile(disk.path) as run:
        assert run.state is RunState.INTERRUPTED
        assert why in run.reason
        assert (len(run.table()), run.frames_acquired, run.losses) == (2, 3, ())
