"""The ring and its consumers: what each gets, what is counted, and that another process sees the same pixels."""

import multiprocessing
import pickle
import threading

import numpy as np
import pytest

from bscd.acquisition import FrameLoss, FrameRecord
from bscd.acquisition.stream import FrameAccount, FrameRing, Keep, LiveView
from bscd.errors import BscdError
from bscd.shared_frames import FrameWindow, SharedBuffers

SHAPE = (6, 8)


def record(number: int) -> FrameRecord:
    return FrameRecord("primary", "inflation", np.full(SHAPE, number % 256, np.uint8), frame_id=100 + number)


@pytest.fixture
def ring():
    with FrameRing(SHAPE, np.uint8, slots=10) as ring:
        yield ring


def publish(ring, *numbers):
    return [ring.publish(number, record(number)) for number in numbers]


def numbers(subscription):
    found = []
    while (lease := subscription.take(0.0)) is not None:
        with lease:
            assert (lease.record.data == lease.number % 256).all()
            assert lease.record.frame_id == 100 + lease.number
            found.append(lease.number)
    return found


def test_a_full_ring_refuses_at_once_and_counts(ring):
    recorder = ring.subscribe("recorder", Keep.ALL)
    assert publish(ring, *range(12)) == [True] * 10 + [False] * 2
    assert (ring.counts, ring.fill, ring.filling_up) == ((10, 2), 10, True)
    assert numbers(recorder) == list(range(10))
    assert (ring.fill, ring.peak_fill, ring.filling_up) == (0, 10, False)
    assert publish(ring, 12) == [True]


def test_in_order_and_bounded_leaves_the_rest_for_the_file(ring):
    recorder, dic = ring.subscribe("recorder", Keep.ALL), ring.subscribe("dic", Keep.FIRST, depth=3)
    publish(ring, 0, 1, 2, 3, 4)
    assert numbers(recorder) == [0, 1, 2, 3, 4]
    assert ring.fill == 3
    held = dic.take(0.0)
    publish(ring, 5)
    assert dic.left_out == (3, 4, 5)
    held.release()
    held.release()
    publish(ring, 6)
    assert numbers(dic) == [1, 2, 6]
    counts = dic.counts()
    assert (counts.offered, counts.taken, counts.left_out, counts.waiting) == (7, 4, 3, 0)
    assert numbers(recorder) == [5, 6]
    assert ring.fill == 0


def test_the_live_view_has_the_newest_and_holds_one_buffer(ring):
    live = LiveView(ring)
    assert live.latest() is None
    publish(ring, 0, 1, 2)
    assert ring.fill == 1
    assert live.latest().frame_id == 102
    assert live.latest().frame_id == 102
    assert (live.counts().left_out, ring.fill) == (2, 0)


def test_a_published_frame_can_not_be_changed_by_source_or_consumer(ring):
    recorder, frame = ring.subscribe("recorder", Keep.ALL), record(7)
    ring.publish(0, frame)
    frame.data[:] = 0
    with recorder.take(0.0) as lease:
        assert (lease.record.data == 7).all()
        with pytest.raises(ValueError, match="read-only"):
            lease.record.data[0, 0] = 1


def test_the_end_lets_waiting_frames_be_taken_and_no_more_come(ring):
    recorder = ring.subscribe("recorder", Keep.ALL)
    publish(ring, 0)
    ring.end()
    assert not recorder.ended
    assert numbers(recorder) == [0]
    assert recorder.ended
    assert recorder.take(60.0) is None
    with pytest.raises(BscdError, match="closed"):
        publish(ring, 1)


def test_taking_waits_for_the_frame(ring):
    recorder = ring.subscribe("recorder", Keep.ALL)
    later = threading.Timer(0.05, publish, (ring, 3))
    later.start()
    with recorder.take(30.0) as lease:
        assert lease.number == 3
    later.join(30.0)


def test_a_consumer_that_left_holds_nothing(ring):
    dic = ring.subscribe("dic", Keep.FIRST, depth=3)
    publish(ring, 0, 1)
    dic.close()
    assert (ring.fill, dic.ended, dic.left_out) == (0, True, (0, 1))
    publish(ring, 2)
    assert ring.fill == 0


def test_bounded_consumers_must_leave_room_for_the_recorder(ring):
    ring.subscribe("dic", Keep.FIRST, depth=5)
    with pytest.raises(BscdError, match="live view: 2 buffers do not fit beside 5"):
        ring.subscribe("live view", Keep.NEWEST, depth=2)


def seen_elsewhere(handle, answers):
    window = FrameWindow()
    image = window.view(pickle.loads(handle))
    answers.put((image.shape, int(image.sum()), image.flags.writeable))
    window.close()


def test_another_process_reads_a_frame_where_it_is(ring):
    dic = ring.subscribe("dic", Keep.FIRST, depth=2)
    publish(ring, 4, 5)
    dic.take(0.0).release()
    context = multiprocessing.get_context("spawn")
    answers = context.SimpleQueue()
    with dic.take(0.0) as lease:
        worker = context.Process(target=seen_elsewhere, args=(pickle.dumps(lease.handle), answers))
        worker.start()
        worker.join(60.0)
        assert worker.exitcode == 0
        assert answers.get() == (SHAPE, 5 * 48, False)
    worker.close()
    answers.close()


def test_frames_whose_owner_is_gone_are_not_mistaken_for_another_file(tmp_path):
    buffers = SharedBuffers(2, SHAPE, np.uint16)
    handle = buffers.handle(0, 0)
    buffers.close()
    buffers.close()
    with (tmp_path / "other").open("w"), pytest.raises(FileNotFoundError):
        FrameWindow().view(handle)


def test_the_account_closes_by_number_with_reasons():
    account = FrameAccount()
    assert account.exposed(0, "") == 0
    assert account.exposed(3, "lost by the camera") == 2
    account.lose(3, "the ring was full")
    account.exposed(4, "")
    account.lose(4, "the ring was full")
    assert account.ended(6, "lost by the camera") == 1
    assert (account.acquired, account.lost) == (6, 5)
    assert account.losses == (
        FrameLoss(1, 2, "lost by the camera"),
        FrameLoss(3, 2, "the ring was full"),
        FrameLoss(5, 1, "lost by the camera"),
    )
    assert account.difference(1) == ""
    assert "6 exposures, but 2 frames written and 5 counted as lost" in account.difference(2)
    with pytest.raises(ValueError, match="exposure 2 comes after exposure 5"):
        account.exposed(2, "")
