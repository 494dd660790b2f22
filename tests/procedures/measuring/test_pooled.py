"""Measured by pools of workers: bit for bit what one process measures, whatever becomes of the workers."""

import os
import signal
import threading

import pytest

from bscd.acquisition import RunFile
from bscd.cli.app import run as bscd
from bscd.dic.pool import DaskPool, LocalPool, PoolClosedError
from bscd.procedures.measuring import MeasureSettings, measure_run, pooled
from bscd.results import ResultsFile
from tests.dic.pool.cluster import cluster
from tests.results.measured import same

SETTINGS = MeasureSettings(step_px=20, strain=False)


def measured(wide, path, pool=None, after_frame=lambda number: None):
    """Frames, with something done after each."""
    frames = []
    with RunFile(path) as run:
        for frame in measure_run(wide, run, SETTINGS, pool=pool).frames:
            frames.append(frame)
            after_frame(frame.number)
    return frames


@pytest.fixture(scope="module")
def plain(wide, inflation_run):
    return measured(wide, inflation_run)


@pytest.fixture(scope="module")
def two_workers():
    with LocalPool(2) as pool:
        yield pool


def held():
    return {name for name in os.listdir("/dev/shm") if name.startswith(f"bscd-{os.getpid()}-")}


def all_same(frames, others):
    return [same(one, other) for one, other in zip(frames, others, strict=True)] == [True] * len(others)


def test_the_sequence_is_worth_it(plain):
    assert len(plain) == 12
    assert plain[-1].valid.mean() > 0.5


@pytest.mark.parametrize("chunk", [1, 8])
def test_the_size_of_chunks_does_not_matter(wide, inflation_run, plain, two_workers, monkeypatch, chunk):
    monkeypatch.setattr(pooled, "CHUNK", chunk)
    assert all_same(measured(wide, inflation_run, two_workers), plain)


@pytest.mark.parametrize("workers", [1, 3])
def test_nor_does_the_number_of_workers(wide, inflation_run, plain, workers):
    with LocalPool(workers) as pool:
        assert all_same(measured(wide, inflation_run, pool), plain)


def test_nor_do_workers_that_are_killed(wide, inflation_run, plain, monkeypatch):
    monkeypatch.setattr(pooled, "CHUNK", 1)
    with LocalPool(2) as pool:

        def kill(number):
            if number in (1, 4, 7):  # farther apart than frames are tracked ahead, so no task is hit twice
                os.kill(pool.process_ids[number % 2], signal.SIGKILL)

        assert all_same(measured(wide, inflation_run, pool, kill), plain)
        assert pool.restarts == 3


def test_a_cluster_gives_the_same_also_when_a_worker_is_killed(wide, inflation_run, plain, monkeypatch, tmp_path):
    monkeypatch.setattr(pooled, "CHUNK", 2)
    with cluster(tmp_path) as running, DaskPool(running.address) as pool:
        assert all_same(measured(wide, inflation_run, pool), plain)

        def kill(number):
            if number == 2:
                running.workers[0].kill()
                running.workers[0].wait(10.0)

        assert all_same(measured(wide, inflation_run, pool, kill), plain)
        assert running.workers[1].poll() is None


def test_leaving_early_ends_threads_and_gives_images_back(wide, inflation_run, two_workers):
    threads, blocks = threading.active_count(), held()
    with RunFile(inflation_run) as run:
        frames = measure_run(wide, run, SETTINGS, pool=two_workers).frames
        next(frames)
        assert held() > blocks
        frames.close()
    assert threading.active_count() == threads
    assert held() == blocks


def test_a_pool_that_is_closed_meanwhile_is_told(wide, inflation_run):
    blocks = held()
    with LocalPool(1) as pool, pytest.raises(PoolClosedError):
        measured(wide, inflation_run, pool, lambda _: pool.close())
    assert held() == blocks


def test_no_more_images_are_held_than_are_needed(wide, inflation_run, two_workers, monkeypatch):
    monkeypatch.setattr(pooled, "CHUNK", 1)
    blocks, most = held(), []
    measured(wide, inflation_run, two_workers, lambda _: most.append(len(held() - blocks)))
    assert 1 < max(most) <= 3 + 5  # three chunks under way; the reference, and those that became one
    assert held() == blocks


def test_the_command(wide, inflation_run, tmp_path, capsys):
    wide.save(tmp_path / "cal.h5")

    def measure(out, *more):
        given = [str(tmp_path / "cal.h5"), str(inflation_run), "-o", str(tmp_path / out), "--step", "25", "--no-strain"]
        return bscd(["measure", *given, *more])

    assert measure("one.h5") == 0
    assert measure("two.h5", "--workers", "2") == 0
    with ResultsFile(tmp_path / "one.h5") as one, ResultsFile(tmp_path / "two.h5") as two:
        assert all(same(a, b) for a, b in zip(one.frames(), two.frames(), strict=True))
        assert one.header.parameters == two.header.parameters
    capsys.readouterr()
    assert measure("three.h5", "--workers", "2", "--dask", "tcp://127.0.0.1:1") == 2
    assert measure("three.h5", "--workers", "0") == 2
    capsys.readouterr()
    assert measure("three.h5", "--dask", "nowhere://1") == 1
    assert "no Dask scheduler answers there" in capsys.readouterr().err
    assert not (tmp_path / "three.h5").exists()
