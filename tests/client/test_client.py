"""The client against a real daemon: it follows a job to its end, and raises what the daemon refuses."""

from __future__ import annotations

import threading
from contextlib import ExitStack

import numpy as np
import pytest

import bscd
from bscd.acquisition import FrameRecord, RunWriter
from bscd.client import AsyncClient, Client, NoDaemonError, NoPermissionError
from bscd.daemon.documents import JobStatus
from bscd.daemon.errors import (
    IllegalRequestError,
    InterlockError,
    NotInControlError,
    UnknownNameError,
)
from bscd.daemon.estop_listener import EStopListener
from bscd.errors import BscdError, InputError
from tests.api.serving import api_of
from tests.daemon.small import WAIT_S, small_daemon, until
from tests.procedures.measuring.twin_runs import CAMERA


@pytest.fixture
def client(url):
    with Client(url, operator="anna") as opened:
        yield opened


def test_it_is_part_of_the_package():
    assert bscd.Client is Client
    assert bscd.AsyncClient is AsyncClient


def test_a_job_is_followed_to_its_end(client):
    job = client.submit({"recipe": "move", "axis": "jacks", "position": 20.0}, idempotency_key="a")
    assert job.operator == "anna"
    assert client.submit({"recipe": "move", "axis": "jacks", "position": 20.0}, idempotency_key="a").id == job.id
    seen = list(client.follow(job.id))
    assert seen[-1].status is JobStatus.DONE
    assert seen[-1].figures["jacks_mm"] == pytest.approx(20.0, abs=0.2)
    assert all(one.id == job.id for one in seen)
    assert list(client.follow(job.id))[-1] == seen[-1]
    assert client.wait(job.id) == client.job(job.id)
    assert job.id in {one.id for one in client.jobs()}


def test_it_tells_what_the_daemon_refuses(client):
    with pytest.raises(InterlockError, match="its limits are 0 to 84 mm") as refused:
        client.submit({"recipe": "move", "axis": "jacks", "position": 1000.0})
    assert refused.value.problems == ("jacks: 1000 mm is needed, its limits are 0 to 84 mm",)
    with pytest.raises(IllegalRequestError) as illegal:
        client.connect()
    assert (illegal.value.state, illegal.value.allowed) == ("idle", ("disconnect", "start", "estop"))
    with pytest.raises(UnknownNameError, match="there is none of that name"):
        client.job("20200101-000000-0000")
    with pytest.raises(InputError, match="fly"):
        client.submit({"recipe": "fly"})
    with pytest.raises(BscdError, match="nothing"):
        client.download("run", "nothing", "nowhere.h5")


def test_control_is_one_persons_at_a_time(client, url):
    with client.control() as lease, Client(url, operator="bert") as other:
        assert lease.holder == "anna"
        with pytest.raises(NotInControlError, match="anna is in control"):
            other.submit({"recipe": "home"})
        with other.control(force=True):
            pass
    assert client.status().lease is None
    with pytest.raises(RuntimeError, match="in the block"), client.control():
        raise RuntimeError("in the block")
    assert client.status().lease is None


def test_the_e_stop_and_its_own_address_when_the_api_is_gone(client, daemon):
    told = client.estop("a test")
    assert told.by == "anna: a test"
    assert client.status().estop.latched
    assert client.reset_estop().state.value == "idle"
    listener = EStopListener(daemon.estop, "127.0.0.1", 0, lambda key: "local")
    try:
        with Client("http://127.0.0.1:9", estop_url=f"http://127.0.0.1:{listener.port}/estop") as lost:
            assert lost.estop().latched
    finally:
        listener.close()
    assert daemon.estop.latched
    client.reset_estop()


def test_a_download_that_was_cut_off_goes_on(client, daemon, tmp_path):
    path = daemon.files.new("run", "one")
    with RunWriter(path, title="a run", cameras={"primary": CAMERA}) as run:
        run.append(FrameRecord("primary", "sphere", np.zeros((1024, 1280), np.uint8), 0))
    assert [document.name for document in client.files("run")] == ["one"]
    whole = path.read_bytes()
    (tmp_path / "one.h5.part").write_bytes(b"x" * 1000)
    assert client.download("run", "one", tmp_path / "one.h5").read_bytes() == b"x" * 1000 + whole[1000:]
    assert not (tmp_path / "one.h5.part").exists()
    with pytest.raises(BscdError, match="exists already"):
        client.download("run", "one", tmp_path / "one.h5")


def test_a_snapshot(client, daemon):
    daemon.latest.put("primary", np.zeros((64, 64), np.uint8), 1, 1)
    assert client.snapshot("primary", 320)[:2] == b"\xff\xd8"


def test_nobody_there_is_said_in_a_sentence():
    with Client("http://127.0.0.1:9") as client, pytest.raises(NoDaemonError, match="start one with bscd serve"):
        client.status()
    with pytest.raises(InputError, match="is no address of a daemon"):
        Client("rig")
    for url in ("http://[::1", "http://127.0.0.1:99999", "http://127.0.0.1:x", "http://::1:8080", "ftp://rig"):
        with pytest.raises(InputError, match="is no address of a daemon"):
            Client(url)


def test_a_wrong_key_is_said_so(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, connected=False) as daemon:
        key = daemon.keys.add("anna", "viewer")
        with api_of(daemon) as api:
            with Client(str(api.base_url)) as nobody, pytest.raises(NoPermissionError, match="a key is needed"):
                nobody.status()
            with Client(str(api.base_url), key=key) as viewer:
                assert viewer.status().state.value == "offline"
                with pytest.raises(NoPermissionError, match="anna is viewer; this needs operator"):
                    viewer.connect()


def test_a_broken_line_is_mended_while_a_job_is_followed(tmp_path):
    """The server goes away in the middle and comes back on the same port."""
    seen = []
    with small_daemon(tmp_path, sensor_px=320, virtual=False, attended=True) as other, ExitStack() as ends:
        with api_of(other) as api:
            port = api.base_url.port
            client = ends.enter_context(Client(str(api.base_url)))
            job = client.submit({"recipe": "home", "prompt": "go?"})
            following = threading.Thread(target=lambda: seen.extend(client.follow(job.id)))
            following.start()
            until(lambda: other.job(job.id).status is JobStatus.WAITING, "the question")
            until(lambda: other.events._subscriptions, "a listener")
        # the first server is gone; the job goes on
        with api_of(other, port):
            other.confirm(job.id, other.job(job.id).prompt.id, "test")
            following.join(WAIT_S)
            assert not following.is_alive()
    assert seen[-1].status is JobStatus.DONE
