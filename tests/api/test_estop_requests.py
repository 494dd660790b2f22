"""The e-stop by the API: a wrong key where one is needed is all that refuses it."""

from __future__ import annotations

import http.client
import socket
from contextlib import closing

import pytest

from bscd.api.security import Gate
from bscd.daemon.estop_listener import EStopListener
from bscd.daemon.keys import LOCAL
from tests.api.serving import api_of
from tests.daemon.small import small_daemon, until

ESTOP = "/api/v1/estop"
FORM = {"Content-Type": "application/x-www-form-urlencoded"}


@pytest.fixture
def armed(api, daemon):
    """A daemon that is not stopped, before and after."""
    yield daemon
    if daemon.estop.latched:
        daemon.reset_estop("test")


def by(answer):
    assert answer.status_code == 200, answer.text
    told = answer.json()
    assert told["latched"] is True
    return told["by"]


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({}, "local"),
        ({"json": {"reason": "it smells"}}, "local: it smells"),
        ({"json": {"reason": "x" * 300}}, "local: " + "x" * 200),
        ({"json": {"reason": "two\nlines\t\u0000 \u202e"}}, "local: two lines"),
        ({"content": '{"reason": "\\ud800 half"}'}, "local: half"),
        ({"json": {"reason": 3}}, "local"),
        ({"json": {"why": "it smells"}}, "local"),
        ({"json": {"why": "it smells", "reason": "smoke"}}, "local: smoke"),
        ({"json": ["reason"]}, "local"),
        ({"content": '{"reason": "it'}, "local"),
        ({"content": b"\xff\xfe"}, "local"),
        ({"content": "[" * 100_000}, "local"),
        ({"content": "reason=it+smells", "headers": FORM}, "local"),
        ({"files": {"reason": b"it smells"}}, "local"),
        ({"headers": {"X-Operator": "DOM\\alice"}}, "local"),
        ({"headers": {"X-Operator": "<script>"}, "json": {"reason": "smoke"}}, "local: smoke"),
        ({"headers": {"X-Operator": b"zo\xc3\xab"}}, "local"),
        ({"headers": {"X-Operator": ""}}, "local"),
        ({"headers": {"X-Operator": "anna"}}, "anna"),
        ({"headers": {"Authorization": "Bearer no key"}}, "local"),
        ({"headers": {"Authorization": "Basic YTpi"}}, "local"),
        ({"headers": {"Idempotency-Key": ""}}, "local"),
        ({"headers": {"Host": "rig.example"}}, "local"),
        ({"params": {"token": "none"}}, "local"),
    ],
)
def test_nothing_that_is_sent_keeps_it_from_stopping(api, armed, asked, told):
    assert by(api.post(ESTOP, **asked)) == told
    assert armed.estop.latched


def test_a_slash_at_its_end_is_no_other_address(api, armed):
    assert by(api.post(f"{ESTOP}/", json={"reason": "smoke"})) == "local: smoke"


def test_a_body_beyond_every_limit_stops_too(api, armed):
    def pieces():
        for _ in range(30):
            yield b" " * 100_000

    assert by(api.post(ESTOP, content=b" " * (armed.settings.request_limit_bytes + 1))) == "local"
    armed.reset_estop("test")
    assert by(api.post(ESTOP, content=pieces())) == "local"


@pytest.mark.parametrize("then", ["waits", "leaves"])
def test_a_body_that_never_comes_is_not_waited_for(api, armed, then):
    with closing(socket.create_connection((api.base_url.host, api.base_url.port), 20.0)) as line:
        head = f"POST {ESTOP} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 50\r\n\r\n" + '{"reason'
        line.sendall(head.encode())
        if then == "waits":
            assert line.recv(100).startswith(b"HTTP/1.1 200")
    until(lambda: armed.estop.latched and armed.estop.triggers() is not None, "the e-stop and its end")


def test_a_page_of_another_host_does_not_stop_the_rig(api, armed):
    for headers in ({"Origin": "http://evil.example"}, {"Origin": "http://["}):
        assert api.post(ESTOP, headers=headers).status_code == 403
    rebound = {"Origin": "http://evil.example", "Host": "evil.example"}
    assert api.post(ESTOP, headers=rebound).json()["code"] == "wrong-host"
    assert not armed.estop.latched


def test_keys_that_can_not_be_read_do_not_keep_this_computer_from_stopping(tmp_path):
    with small_daemon(tmp_path, sensor_px=320) as daemon, api_of(daemon) as api:
        daemon.keys.path.write_text("{broken")
        assert api.get("/api/v1/status").status_code == 422
        assert by(api.post(ESTOP, headers={"X-Operator": "anna"})) == "anna"
        daemon.estop.reset(daemon.estop.triggers())
        with closing(EStopListener(daemon.estop, "127.0.0.1", 0, Gate(daemon).admit)) as listener:
            connection = http.client.HTTPConnection("127.0.0.1", listener.port, timeout=20.0)
            with closing(connection):
                connection.request("POST", "/estop")
                assert connection.getresponse().status == 200
        assert daemon.estop.latched


def test_where_keys_are_needed_a_wrong_one_is_refused_and_a_right_one_never(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, connected=False) as daemon:
        key = daemon.keys.add("anna", "viewer")
        with api_of(daemon) as api:
            for headers in ({}, {"Authorization": "Bearer x"}, {"X-Operator": "anna"}):
                assert api.post(ESTOP, headers=headers).status_code == 401
            assert not daemon.estop.latched
            right = {"Authorization": f"bearer {key}", "X-Operator": "DOM\\alice"}
            assert by(api.post(ESTOP, content="{", headers=right)) == "anna"


def test_elsewhere_the_keys_that_were_read_last_still_stop(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, connected=False, host="0.0.0.0") as daemon:
        key = daemon.keys.add("anna", "viewer")
        gate = Gate(daemon)
        assert gate.admit(key) == "anna"
        daemon.keys.path.write_text("{broken")
        assert gate.admit(key) == "anna"
        assert gate.admit("") is None
        assert gate.admit(key[:-1] + ("A" if key[-1] != "A" else "B")) is None


def test_who_needs_no_key_is_local(daemon):
    assert Gate(daemon).admit("") == LOCAL
    assert Gate(daemon).admit("bscd_revoked") == LOCAL
