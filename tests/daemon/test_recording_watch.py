"""What is known of a recording that goes on."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bscd.acquisition.names import RECORDER
from bscd.acquisition.stream import FrameRing, Keep
from bscd.daemon.running.bench_work import _live
from bscd.daemon.running.recording_watch import RecordingWatch
from bscd.procedures.live import LiveFrame
from tests.acquisition.run_records import frames


@pytest.fixture
def ring():
    with FrameRing((8, 12), np.uint8, 8) as ring:
        yield ring


def publish(ring, count):
    record = next(iter(frames(1)))
    for _ in range(count):
        number = ring.counts[0]
        assert ring.publish(number, replace(record, frame_id=number))


def test_it_moves_with_the_daemon_unless_frames_wait_for_the_disk(ring):
    watch, recorder = RecordingWatch(), ring.subscribe(RECORDER, Keep.ALL)
    assert (watch.progress(5), watch.progress(6)) == (5, 6)  # nothing is recorded
    watch.begin(ring)
    assert watch.progress(7) == 7
    assert not watch.streaming
    publish(ring, 3)
    assert watch.streaming
    assert watch.frames == 3
    assert watch.progress(8) == watch.progress(9) == 7
    with recorder.take(1.0):
        assert watch.progress(10) == 8
    for _ in range(2):
        recorder.take(1.0).release()
    assert watch.progress(11) == 14
    watch.end()
    assert not watch.streaming
    assert watch.progress(12) == 12


def test_a_live_map_says_how_far_it_is_behind(ring):
    watch, told = RecordingWatch(), []
    ring.subscribe(RECORDER, Keep.ALL)
    watch.begin(ring)
    publish(ring, 6)
    work = SimpleNamespace(watch=watch, reporting=SimpleNamespace(live=lambda event, document: told.append(document)))
    nothing = np.zeros((0, 3), np.float32)
    for number in (3, 5):
        figures = {"time_s": 0.3, "pressure_kpa": 1.0, "points": 10, "valid": 9, "w_max_mm": 1.0, "latency_s": 0.1}
        maps = dict.fromkeys(("points_px", "xyz_mm", "uvw_mm", "sigma_mm", "zncc"), nothing)
        none = np.zeros(0, np.int64)
        _live(LiveFrame(number, provisional=False, index=none, status=none.astype(np.uint8), **figures, **maps), work)
    assert [document.behind for document in told] == [2, 0]
