"""Worker processes: what they are given comes back, whatever happens to them."""

import os
import signal
import threading

import numpy as np
import pytest

from bscd.dic.pool import LocalPool, PoolClosedError, WorkerLostError
from bscd.errors import InputError
from tests.dic.pool import tasks

WAIT_S = 60.0


@pytest.fixture(scope="module")
def pool():
    with LocalPool(2) as workers:
        yield workers


def test_an_image_is_read_by_any_worker_and_gone_when_released(pool):
    image = np.arange(12, dtype=np.uint16).reshape(3, 4)
    lent = pool.lend(image)
    image[:] = 0
    given = [pool.submit(tasks.total, lent, factor, near=str(factor)) for factor in (1, 2, 3)]
    assert [future.result(WAIT_S) for future in given] == [66.0, 132.0, 198.0]
    lent.release()
    assert lent.name not in os.listdir("/dev/shm")
    with pytest.raises(FileNotFoundError):
        pool.submit(tasks.total, lent, 1, near="1").result(WAIT_S)


def test_what_is_near_goes_to_one_worker_and_others_to_the_least_busy(pool):
    def where(near):
        return pool.submit(tasks.process_id, near=near).result(WAIT_S)

    one, other = where("left"), where("right")
    assert {one, other} <= set(pool.process_ids)
    assert one != other
    assert [where("left") for _ in range(3)] == [one] * 3


def test_errors_come_back_as_they_are_or_in_words(pool):
    with pytest.raises(ValueError, match="no such thing"):
        pool.submit(tasks.fail, "no such thing", near="a").result(WAIT_S)
    with pytest.raises(RuntimeError, match="Local: an error that can not be unpickled"):
        pool.submit(tasks.fail_oddly, near="a").result(WAIT_S)


def test_a_worker_that_dies_is_started_again_and_its_task_done(pool, tmp_path):
    before = pool.restarts
    assert pool.submit(tasks.die_once, str(tmp_path / "died"), near="a").result(WAIT_S) == "done"
    assert pool.restarts == before + 1


def test_a_worker_killed_from_outside_at_work_and_at_rest(pool, tmp_path):
    first = pool.submit(tasks.process_id, near="k").result(WAIT_S)
    os.kill(first, signal.SIGKILL)
    second = pool.submit(tasks.process_id, near="k").result(WAIT_S)
    assert second != first
    working = pool.submit(tasks.wait_for, str(tmp_path / "go"), str(tmp_path / "on"), near="k")
    tasks.wait_for(tmp_path / "on")
    os.kill(second, signal.SIGKILL)
    (tmp_path / "go").touch()
    assert working.result(WAIT_S) == str(tmp_path / "go")


def test_a_task_that_kills_every_worker_is_given_up_and_the_next_one_done(pool):
    with pytest.raises(WorkerLostError, match="two workers"):
        pool.submit(tasks.die, near="a").result(WAIT_S)
    assert pool.submit(tasks.process_id, near="a").result(WAIT_S) in pool.process_ids


def test_a_worker_that_hangs_counts_as_lost(tmp_path):
    with LocalPool(1, task_timeout_s=1.0) as hanging:
        hanging.submit(tasks.process_id, near="a")
        with pytest.raises(WorkerLostError):
            hanging.submit(tasks.wait_for, str(tmp_path / "never"), near="a").result(WAIT_S)


def test_submitting_waits_while_there_is_enough_to_do_and_a_waiting_task_can_be_called_off(tmp_path):
    submitted = []
    with LocalPool(1) as pool:

        def submit():
            for name in "abcde":
                submitted.append(pool.submit(tasks.wait_for, str(tmp_path / "go"), str(tmp_path / name), near="a"))

        feeding = threading.Thread(target=submit)
        feeding.start()
        tasks.wait_for(tmp_path / "a")
        feeding.join(0.5)
        assert feeding.is_alive()
        assert len(submitted) == 3
        assert submitted[2].cancel()
        (tmp_path / "go").touch()
        feeding.join(WAIT_S)
        assert not feeding.is_alive()
        assert [future.result(WAIT_S) for future in submitted if not future.cancelled()] == [str(tmp_path / "go")] * 4
    assert not (tmp_path / "c").exists()


def test_closing_ends_processes_and_threads_and_fails_what_is_not_done(tmp_path):
    before = threading.active_count()
    pool = LocalPool(1)
    running = pool.submit(tasks.wait_for, str(tmp_path / "never"), str(tmp_path / "on"), near="a")
    waiting = pool.submit(tasks.process_id, near="a")
    tasks.wait_for(tmp_path / "on")
    process_id = pool.process_ids[0]
    pool.close()
    for future in (running, waiting):
        with pytest.raises(PoolClosedError):
            future.result(WAIT_S)
    with pytest.raises(ProcessLookupError):
        os.kill(process_id, 0)
    assert threading.active_count() == before
    with pytest.raises(PoolClosedError):
        pool.submit(tasks.process_id, near="a")


def test_priority_is_lowered():
    with LocalPool(1, nice=5) as pool:
        assert pool.submit(tasks.priority, near="a").result(WAIT_S) == min(os.nice(0) + 5, 19)


def test_no_pool_without_workers():
    with pytest.raises(InputError, match="at least 1"):
        LocalPool(0)
