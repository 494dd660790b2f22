"""The asynchronous client does what the other does."""

from __future__ import annotations

import asyncio
import inspect
from contextlib import closing

import numpy as np
import pytest

from bscd.acquisition import FrameRecord, RunWriter
from bscd.client import AsyncClient, Client
from bscd.daemon.documents import JobStatus
from bscd.daemon.errors import InterlockError, NotInControlError
from bscd.daemon.estop_listener import EStopListener
from bscd.errors import BscdError
from tests.api.serving import api_of
from tests.daemon.small import WAIT_S, small_daemon
from tests.procedures.measuring.twin_runs import CAMERA


def public(kind):
    return {name: call for name, call in vars(kind).items() if not name.startswith("_") and callable(call)}


def test_they_have_the_same_calls():
    one, other = public(Client), public(AsyncClient)
    assert set(one) == set(other)
    for name in one:
        taken, taken_too = inspect.signature(one[name]).parameters, inspect.signature(other[name]).parameters
        assert {key: str(value) for key, value in taken.items()} == {
            key: str(value) for key, value in taken_too.items()
        }
        assert one[name].__doc__ == other[name].__doc__, name


def test_jobs(url):
    async def work():
        async with AsyncClient(url, operator="anna") as client:
            job = await client.submit({"recipe": "move", "axis": "jacks", "position": 30.0})
            over = await client.wait(job.id)
            assert over.figures["jacks_mm"] == pytest.approx(30.0, abs=0.2)
            assert (await client.status()).state.value == "idle"
            with pytest.raises(InterlockError):
                await client.submit({"recipe": "move", "axis": "jacks", "position": 1000.0})
            looked = await client.validate({"recipe": "home"})
            assert looked.ok
            assert {one.id for one in await client.jobs()} >= {job.id}
            assert job.id not in {one.id for one in await client.jobs(before=job.id)}
            assert (await client.disconnect()).state.value == "offline"
            assert (await client.connect()).state.value == "idle"

    asyncio.run(work())


async def now_as(client, job, is_so):
    for _ in range(round(WAIT_S / 0.01)):
        now = await client.job(job.id)
        if is_so(now):
            return now
        await asyncio.sleep(0.01)
    raise AssertionError(f"it never was: {now}")


async def waiting(client, job):
    return await now_as(client, job, lambda now: now.prompt is not None)


def test_a_job_is_confirmed_paused_stopped_and_begun_again(tmp_path):
    async def work(url):
        async with AsyncClient(url) as client:
            asks = {"recipe": "home", "prompt": "hands off?"}
            job = await waiting(client, await client.submit(asks))
            await client.pause(job.id)
            await now_as(client, job, lambda now: now.status is JobStatus.PAUSED)
            await client.resume(job.id)
            await client.confirm(job.id, (await waiting(client, job)).prompt.id)
            assert (await client.wait(job.id)).status is JobStatus.DONE
            job = await waiting(client, await client.submit(asks))
            await client.stop(job.id)
            with pytest.raises(BscdError, match="stopped"):
                await client.wait(job.id)
            await client.resume_from(job.id)
            await waiting(client, job)
            await client.abort(job.id, "smoke")
            with pytest.raises(BscdError, match=r"aborted: .*smoke"):
                await client.wait(job.id)

    opened = small_daemon(tmp_path, sensor_px=320, virtual=False, attended=True, requests_per_s=10_000.0)
    with opened as daemon, api_of(daemon) as api:
        asyncio.run(work(str(api.base_url)))


def test_control_is_given_back_also_after_an_error(url):
    async def work():
        async with AsyncClient(url, operator="anna") as client, AsyncClient(url, operator="bert") as other:
            async with client.control(force=True) as lease:
                assert lease.holder == "anna"
                with pytest.raises(NotInControlError, match="anna is in control"):
                    await other.submit({"recipe": "home"})
            assert (await client.status()).lease is None
            with pytest.raises(RuntimeError, match="in the block"):
                async with client.control():
                    raise RuntimeError("in the block")
            assert (await client.status()).lease is None

    asyncio.run(work())


def test_a_download_goes_on_where_it_was_cut_off(url, daemon, tmp_path):
    path = daemon.files.new("run", "one")
    with RunWriter(path, title="a run", cameras={"primary": CAMERA}) as run:
        run.append(FrameRecord("primary", "sphere", np.zeros((1024, 1280), np.uint8), 0))
    whole, to = path.read_bytes(), tmp_path / "one.h5"
    (tmp_path / "one.h5.part").write_bytes(b"x" * 1000)

    async def work():
        async with AsyncClient(url) as client:
            assert (await client.download("run", "one", to)).read_bytes() == b"x" * 1000 + whole[1000:]
            with pytest.raises(BscdError, match="exists already"):
                await client.download("run", "one", to)
            with pytest.raises(BscdError, match="nothing"):
                await client.download("run", "nothing", tmp_path / "none.h5")

    asyncio.run(work())
    assert [one.name for one in tmp_path.iterdir()] == ["one.h5"]


def test_the_e_stop_and_its_own_address_when_the_api_is_gone(url, daemon):
    async def work(estop_url):
        async with AsyncClient(url, operator="anna") as client:
            assert (await client.estop("a test")).by == "anna: a test"
            assert (await client.reset_estop()).state.value == "idle"
        async with AsyncClient("http://127.0.0.1:9", operator="anna", estop_url=estop_url) as lost:
            assert (await lost.estop("smoke")).by == "anna, e-stop listener, 127.0.0.1: smoke"

    with closing(EStopListener(daemon.estop, "127.0.0.1", 0, lambda key: "local")) as listener:
        asyncio.run(work(f"http://127.0.0.1:{listener.port}/estop"))
    assert daemon.estop.latched
    daemon.reset_estop("test")
