"""What the audit keeps: also what crashed and what was refused at the door, without being flooded."""

from __future__ import annotations

import http.client
from contextlib import closing

import httpx
import pytest
import structlog

from bscd.api.refusals import Refusals
from bscd.api.server import Served, serve
from bscd.daemon.journal import JournalError
from tests.api.serving import api_of
from tests.daemon.small import small_daemon

API = "/api/v1"


def lines(daemon, outcome):
    return [line for line in daemon.journal.audits(1000) if line.outcome == str(outcome)]


def test_what_crashes_is_noted(tmp_path, monkeypatch):
    with small_daemon(tmp_path, sensor_px=320, connected=False) as daemon, api_of(daemon) as api:
        monkeypatch.setattr(daemon, "submit", lambda *_, **__: 1 / 0)
        with structlog.testing.capture_logs() as logged:
            answer = api.post(f"{API}/jobs", json={"recipe": "home"}, headers={"X-Operator": "anna"})
        assert answer.status_code == 500
        assert [one["event"] for one in logged if one["log_level"] == "error"] == ["a mistake in the program"]
        assert answer.headers["content-type"] == "application/problem+json"
        (line,) = lines(daemon, 500)
        assert (line.who, line.action, line.target) == ("anna", "POST", f"{API}/jobs")
        assert line.detail == "ZeroDivisionError; see the log"


def test_a_flood_of_requests_leaves_a_line(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, connected=False, requests_per_s=0.1) as daemon, api_of(daemon) as api:
        assert [api.get(f"{API}/status").status_code for _ in range(3)] == [200, 429, 429]
        assert lines(daemon, 429) == []  # they would have changed nothing
        assert {api.post(f"{API}/jobs", json={"recipe": "home"}).status_code for _ in range(30)} == {429}
        (line,) = lines(daemon, 429)
        assert (line.who, line.action, line.target) == ("unknown, 127.0.0.1", "POST", f"{API}/jobs")
        assert line.detail == "too many requests; wait a second"


def test_a_flood_of_wrong_keys_at_the_e_stop_leaves_a_line(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, connected=False) as daemon:
        daemon.keys.add("anna", "viewer")
        with api_of(daemon) as api:
            assert {api.post(f"{API}/estop").status_code for _ in range(30)} == {401}
        (line,) = lines(daemon, 401)
        assert (line.who, line.target) == ("unknown, 127.0.0.1", f"{API}/estop")


def test_the_e_stops_own_listener_notes_whom_it_refuses_and_whose_key_it_was(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, connected=False) as daemon:
        key = daemon.keys.add("anna", "viewer")

        def ask(port, method, key=""):
            with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=20.0)) as connection:
                connection.request(method, "/estop", headers={"Authorization": f"Bearer {key}"})
                return connection.getresponse().status

        asked = []

        def ready(served: Served):
            port = httpx.URL(served.estop_url).port
            asked.extend([ask(port, "GET"), *(ask(port, "POST") for _ in range(5)), ask(port, "POST", key)])
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            serve(daemon, ready)
        assert asked == [401] * 6 + [200]
        (line,) = lines(daemon, 401)
        assert (line.who, line.action, line.target) == ("unknown, 127.0.0.1", "POST", "/estop")
        assert daemon.estop.document().by == "anna, e-stop listener, 127.0.0.1"


class Kept:
    """A journal that keeps lines, or fails."""

    def __init__(self):
        self.lines, self.fails = [], False

    def audit(self, *line):
        if self.fails:
            raise JournalError("full")
        self.lines.append(line)


def test_refusals_are_a_line_each_ten_seconds_and_address():
    journal, now = Kept(), [0.0]
    refusals = Refusals(journal, clock=lambda: now[0])

    def refuse(address):
        if refusals.due(address):
            refusals.note(address, "POST", "/x", 429, "too many")

    for _ in range(50):
        refuse("a")
        refuse("b")
    assert [line[0] for line in journal.lines] == ["unknown, a", "unknown, b"]
    now[0] = 10.5
    refuse("a")
    assert journal.lines[-1] == ("unknown, a", "POST", "/x", "429", "too many; 98 others like it are not noted")
    for number in range(500):
        refuse(str(number))
    assert len(journal.lines) < 3 + 100
    now[0], journal.fails = 30.0, True
    refuse("a")  # told to the log
