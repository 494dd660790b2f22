"""The client's e-stop has two ways: whatever is wrong with the first, it takes the second."""

from __future__ import annotations

import asyncio
import threading
from contextlib import closing, contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from bscd.client import ApiError, AsyncClient, Client, NoDaemonError, NoPermissionError
from bscd.daemon.estop import EmergencyStop
from bscd.daemon.estop_listener import EStopListener
from bscd.daemon.guards import Latch


@contextmanager
def answering(status, body=b"", **headers):
    """Something that answers every request alike."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            self.rfile.read(int(self.headers["Content-Length"]))  # unread it would cut off the answer
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format, *args):
            return

    server = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@pytest.fixture
def own():
    estop = EmergencyStop(Latch(), {"jacks": lambda: None})
    with closing(estop), closing(EStopListener(estop, "127.0.0.1", 0, lambda key: key or "local")) as listener:
        yield estop, f"http://127.0.0.1:{listener.port}/estop"


def by_sync(*place, **how):
    with Client(*place, **how) as client:
        return client.estop("smoke").by


def by_async(*place, **how):
    async def work():
        async with AsyncClient(*place, **how) as client:
            return (await client.estop("smoke")).by

    return asyncio.run(work())


@pytest.fixture(params=[by_sync, by_async], ids=["sync", "async"])
def stopped_by(request):
    return request.param


@pytest.mark.parametrize(
    ("status", "body"),
    [
        (422, b'{"code": "input", "detail": "no"}'),
        (409, b'{"code": "illegal-request", "detail": "no"}'),
        (500, b""),
        (503, b'{"code": "device", "detail": "no"}'),
        (404, b"<html>"),
        (307, b""),
        (200, b"<html>some other program</html>"),
        (200, b'{"latched": true, "of another version": 1}'),
    ],
)
def test_whatever_the_api_answers_its_own_address_is_asked(own, stopped_by, status, body):
    estop, own_url = own
    with answering(status, body, Location="/elsewhere") as url:
        told = stopped_by(url, estop_url=own_url, operator="anna")
    assert told == "anna, e-stop listener, 127.0.0.1: smoke"
    assert estop.latched


@pytest.mark.parametrize("status", [401, 403])
def test_without_permission_it_is_not(own, stopped_by, status):
    estop, own_url = own
    with answering(status, b'{"code": "unauthorised", "detail": "a key is needed"}') as url:
        with pytest.raises(NoPermissionError, match="a key is needed"):
            stopped_by(url, estop_url=own_url)
        with pytest.raises(NoPermissionError, match="a key is needed"):
            stopped_by("http://127.0.0.1:9", estop_url=f"{url}/estop")
    assert not estop.latched


@pytest.mark.parametrize("own_url", ["http://127.0.0.1:9/estop", "rig", "http://[", "http://rig:x/estop"])
def test_that_neither_stopped_is_said(stopped_by, own_url):
    told = r"not confirmed, act by hand: a mistake; .*: neither"
    mistake = b'{"code": "internal", "detail": "a mistake"}'
    with answering(500, mistake) as url, pytest.raises(NoDaemonError, match=told) as raised:
        stopped_by(url, estop_url=own_url)
    assert own_url in str(raised.value)


def test_an_answer_of_another_version_is_said_in_a_sentence():
    told = r"the answer is none that is known .*; is the daemon of this version"
    with (
        answering(200, b'{"state": "dancing"}') as url,
        Client(url) as client,
        pytest.raises(ApiError, match=told) as it,
    ):
        client.connect()
    assert "\n" not in str(it.value)
