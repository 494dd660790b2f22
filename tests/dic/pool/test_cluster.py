"""The same promises from the workers of a Dask cluster."""

import os
import re
import socket
import subprocess
import sys

import numpy as np
import pytest

from bscd.dic.pool import DaskPool, PoolClosedError, cluster
from bscd.errors import InputError
from tests.dic.pool import cluster as loopback
from tests.dic.pool import tasks

WAIT_S = 60.0


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    with loopback.cluster(tmp_path_factory.mktemp("dask")) as started:
        yield started


@pytest.fixture
def pool(running):
    with DaskPool(running.address) as workers:
        yield workers


def test_images_and_results_travel(pool):
    image = np.arange(12, dtype=np.uint16).reshape(3, 4)
    given = [pool.submit(tasks.total, pool.lend(image), factor, near=str(factor)) for factor in (1, 2, 3)]
    assert [future.result(WAIT_S) for future in given] == [66.0, 132.0, 198.0]


def test_what_is_near_stays_with_its_worker(pool):
    where = [pool.submit(tasks.process_id, near="a").result(WAIT_S) for _ in range(5)]
    assert len(set(where)) == 1
    assert where[0] != os.getpid()


def test_errors_come_back_as_they_are(pool):
    with pytest.raises(ValueError, match="no such thing"):
        pool.submit(tasks.fail, "no such thing", near="a").result(WAIT_S)


def test_closing_fails_what_is_not_done(running, tmp_path):
    pool = DaskPool(running.address)
    waiting = pool.submit(tasks.wait_for, str(tmp_path / "go"), str(tmp_path / "on"), near="a")
    tasks.wait_for(tmp_path / "on")
    pool.close()
    (tmp_path / "go").touch()
    with pytest.raises(PoolClosedError):
        waiting.result(WAIT_S)
    with pytest.raises(PoolClosedError):
        pool.submit(tasks.process_id, near="a")


def test_workers_of_another_version_are_refused(running, monkeypatch):
    monkeypatch.setattr(cluster, "__version__", "0.0.0")
    with pytest.raises(InputError, match=r"not 0\.0\.0; install the same"):
        DaskPool(running.address)


def test_an_address_without_a_scheduler_is_told_in_a_sentence(monkeypatch):
    monkeypatch.setattr(cluster, "_CONNECT_S", 0.5)
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{nobody.getsockname()[1]}"
        with pytest.raises(InputError, match="no Dask scheduler answers there"):
            DaskPool(address)
    with pytest.raises(InputError, match="no Dask scheduler"):
        DaskPool("nonsense://1")


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("foo", "missing port"),
        ("nonsense://1", "nonsense"),
        ("tcp://foo", "missing port"),
        ("tcp://foo:99999", "99999"),
    ],
)
def test_what_is_no_address_is_told_at_once_and_leaves_no_client(address, why):
    """In a process of its own: what a half-made client says, it says while it is taken away."""
    code = f"from bscd.dic.pool import DaskPool\ntry:\n    DaskPool({address!r})\nexcept Exception as e:\n    print(e)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=15)
    assert done.stderr == ""
    said = rf"{address}: no Dask scheduler answers there \(.*{why}.*\); give its address, tcp://host:8786\n"
    assert re.fullmatch(said, done.stdout)


def test_a_killed_worker_costs_time_not_results(tmp_path):
    with loopback.cluster(tmp_path) as own, DaskPool(own.address) as pool:
        assert pool.submit(tasks.die_once, str(tmp_path / "died"), near="a").result(WAIT_S) == "done"
        assert pool.submit(tasks.process_id, near="a").result(WAIT_S) > 0
