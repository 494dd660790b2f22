"""The e-stop's own listener: who stopped and why, and nothing but a wrong key keeps it from stopping."""

import http.client
import json
import socket
from contextlib import closing

import pytest

from bscd.daemon import estop_listener
from bscd.daemon.estop import EmergencyStop
from bscd.daemon.estop_listener import EStopListener, printable, reason_of
from bscd.daemon.guards import Latch
from bscd.daemon.keys import LOCAL

HOLDERS = {"": LOCAL, "annas": "anna"}


@pytest.fixture
def listening():
    estop, refused = EmergencyStop(Latch(), {"jacks": lambda: None}), []
    listener = EStopListener(estop, "127.0.0.1", 0, HOLDERS.get, refused.append)
    yield estop, listener.port, refused
    listener.close()
    estop.close()


def ask(port, method="POST", path="/estop", body=None, **headers):
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=20.0)) as connection:
        connection.request(method, path, body, named)
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({}, "local, e-stop listener, 127.0.0.1"),
        ({"X_Operator": "bert"}, "bert, e-stop listener, 127.0.0.1"),
        ({"X_Operator": "DOM\\alice"}, "local, e-stop listener, 127.0.0.1"),
        ({"Authorization": "Bearer annas", "X_Operator": "bert"}, "anna, e-stop listener, 127.0.0.1"),
        ({"Authorization": "bearer  annas"}, "anna, e-stop listener, 127.0.0.1"),
        ({"body": b'{"reason": "smoke"}'}, "local, e-stop listener, 127.0.0.1: smoke"),
        ({"body": b'{"reason": "' + b"x" * 500_000 + b'"}'}, "local, e-stop listener, 127.0.0.1: " + "x" * 200),
        ({"body": b" " * 900_000}, "local, e-stop listener, 127.0.0.1"),
        ({"body": b'{"reason'}, "local, e-stop listener, 127.0.0.1"),
        ({"body": iter([b'{"reason": ', b'"in pieces"}'])}, "local, e-stop listener, 127.0.0.1"),
        ({"Content_Length": "many"}, "local, e-stop listener, 127.0.0.1"),
        ({"Content_Length": "-3"}, "local, e-stop listener, 127.0.0.1"),
        ({"path": "/estop/"}, "local, e-stop listener, 127.0.0.1"),
        ({"path": "/api/v1/estop?now"}, "local, e-stop listener, 127.0.0.1"),
        ({"path": "http://rig/estop"}, "local, e-stop listener, 127.0.0.1"),
    ],
)
def test_it_stops_and_says_who_and_why(listening, asked, told):
    estop, port, refused = listening
    status, document = ask(port, **asked)
    assert (status, document["by"]) == (200, told)
    assert estop.latched
    assert refused == []


def test_a_body_that_never_comes_is_not_waited_for(monkeypatch, request):
    monkeypatch.setattr(estop_listener, "_SOCKET_S", 60.0)
    estop, port, _ = request.getfixturevalue("listening")
    with closing(socket.create_connection(("127.0.0.1", port), 20.0)) as line:
        line.sendall(b'POST /estop HTTP/1.1\r\nContent-Length: 50\r\n\r\n{"reason')
        assert line.recv(100).startswith(b"HTTP/1.0 200")
    assert estop.latched


def test_a_wrong_key_is_refused_and_told_of(listening):
    estop, port, refused = listening
    status, told = ask(port, Authorization="Bearer other")
    assert (status, told["code"]) == (401, "unauthorised")
    assert "needs a key" in told["detail"]
    assert refused == ["127.0.0.1"]
    assert not estop.latched


def test_its_state_is_shown_to_who_may_see_it(listening):
    _, port, refused = listening
    assert ask(port, "GET", Authorization="Bearer other")[0] == 401
    assert refused == []  # it would have changed nothing
    status, told = ask(port, "GET", Authorization="Bearer annas")
    assert (status, told["latched"]) == (200, False)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (b"", ""),
        (b'{"reason": "it  smells\\n"}', "it smells"),
        (b'{"reason": "\\ud800\\u0000x"}', "x"),
        (b'{"reason": {"reason": "x"}}', ""),
        (b'"smoke"', ""),
        (b"[" * 100_000, ""),
        (b'{"reason": "zo\xc3\xab \xff"}', "zo\u00eb \ufffd"),
    ],
)
def test_a_reason_is_a_line_of_text(body, reason):
    assert reason_of(body) == reason
    assert len(printable("x" * 1000)) == 200
