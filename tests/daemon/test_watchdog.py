"""What systemd hears: ready, alive while every part makes progress, and silence when one does not."""

from __future__ import annotations

import http.client
import os
import signal
import socket
import threading
import time
from contextlib import ExitStack

import pytest

from bscd.acquisition import RunWriter
from bscd.api.server import Server, listening
from bscd.client import Client
from bscd.daemon.documents import JobStatus
from bscd.daemon.estop_listener import EStopListener
from bscd.daemon.watchdog import Watchdog, notify, period_s
from bscd.procedures import Progress
from tests.api.serving import configuration, idle, serving
from tests.daemon.small import WAIT_S, done, ended, recipe, small_daemon, until


@pytest.fixture(params=["path", "abstract"])
def systemd(request, tmp_path, monkeypatch):
    """A socket where systemd would listen."""
    address = str(tmp_path / "notify") if request.param == "path" else f"@bscd-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind("\0" + address[1:] if address.startswith("@") else address)
        listening.settimeout(WAIT_S)
        monkeypatch.setenv("NOTIFY_SOCKET", address)
        yield listening


def test_without_systemd_nothing_is_told(monkeypatch):
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert not notify("READY=1")
    monkeypatch.setenv("NOTIFY_SOCKET", "/nowhere/at/all")
    assert not notify("READY=1")


@pytest.mark.parametrize(
    ("usec", "pid", "expected"),
    [("3000000", None, 1.0), ("3000000", "1", None), ("", None, None), ("0", None, None), ("x", None, None)],
)
def test_how_often_it_wants_to_hear(monkeypatch, usec, pid, expected):
    monkeypatch.setenv("WATCHDOG_USEC", usec)
    monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()) if pid is None else pid)
    assert period_s() == expected


def test_it_is_fed_while_all_parts_move(systemd):
    counts, still = {"engine": 0, "loop": 0}, threading.Event()

    def counter(name):
        def count():
            if name == "engine" or not still.is_set():
                counts[name] += 1
            return counts[name]

        return count

    watchdog = Watchdog({name: counter(name) for name in counts}, 0.02)
    try:
        assert [systemd.recv(100) for _ in range(3)] == [b"WATCHDOG=1"] * 3
        still.set()
        systemd.settimeout(0.5)
        with pytest.raises(TimeoutError):  # one ping may be on its way; then there is silence
            for _ in range(1000):
                systemd.recv(100)
        assert watchdog.look() == ["loop"]
        still.clear()
        systemd.settimeout(WAIT_S)
        assert systemd.recv(100) == b"WATCHDOG=1"
    finally:
        watchdog.close()


@pytest.mark.timeout(150)
def test_a_daemon_whose_loop_is_blocked_is_not_fed_and_would_be_started_again(tmp_path):
    """SIGSTOP blocks all of it; a blocked event loop alone is the next test's."""
    address = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(address))
        systemd.settimeout(WAIT_S)
        env = {"NOTIFY_SOCKET": str(address), "WATCHDOG_USEC": "3000000"}
        with serving(configuration(tmp_path, 320), env=env) as served, Client(served.url) as client:
            assert systemd.recv(100) == b"READY=1"
            idle(client)
            assert systemd.recv(100) == b"WATCHDOG=1"
            os.kill(served.process.pid, signal.SIGSTOP)
            systemd.settimeout(4.0)
            with pytest.raises(TimeoutError):
                for _ in range(1000):
                    systemd.recv(100)
            os.kill(served.process.pid, signal.SIGCONT)
            systemd.settimeout(WAIT_S)
            assert systemd.recv(100) == b"WATCHDOG=1"
        systemd.settimeout(WAIT_S)
        last = b""
        while last != b"STOPPING=1":
            last = systemd.recv(100)


def test_a_blocked_event_loop_stops_the_pings_and_not_the_e_stop(tmp_path, systemd):
    with small_daemon(tmp_path, sensor_px=320) as daemon, listening("127.0.0.1", 0) as place, ExitStack() as ends:
        ready, free = threading.Event(), threading.Event()
        server = Server(daemon, ready.set)
        listener = EStopListener(daemon.estop, "127.0.0.1", 0, lambda key: "local")
        ends.callback(listener.close)
        thread = threading.Thread(target=lambda: server.run(sockets=[place]), daemon=True)
        thread.start()
        ends.callback(thread.join, WAIT_S)
        ends.callback(setattr, server, "should_exit", True)
        assert ready.wait(WAIT_S)
        assert systemd.recv(100) == b"READY=1"
        watchdog = Watchdog(daemon.progress() | {"event loop": lambda: server.beats}, 1.2)
        ends.callback(watchdog.close)
        ends.callback(free.set)
        assert systemd.recv(100) == b"WATCHDOG=1"
        server._beat.get_loop().call_soon_threadsafe(free.wait, WAIT_S)  # the loop does nothing else now
        ends_s = time.monotonic() + WAIT_S
        while watchdog.look() != ["event loop"]:
            assert time.monotonic() < ends_s
            time.sleep(1.5)
        connection = http.client.HTTPConnection("127.0.0.1", listener.port, timeout=10.0)
        connection.request("POST", "/estop")
        assert connection.getresponse().status == 200
        connection.close()
        assert daemon.estop.latched


def counted(daemon, name, seconds):
    """By how much a counter grows."""
    counter = daemon.progress()[name]
    before = counter()
    time.sleep(seconds)
    return counter() - before


def test_a_recorder_that_stands_still_is_told_also_beside_a_busy_desk(tmp_path, monkeypatch):
    stuck, go = threading.Event(), threading.Event()
    append = RunWriter.append

    def hanging(self, record):
        if self.frames_written > 15:
            stuck.set()
            go.wait(WAIT_S)
        append(self, record)

    monkeypatch.setattr(RunWriter, "append", hanging)
    given = {"rest_frames": 3, "ramp_s": 10.0, "hold_s": 1.0, "top_kpa": 2.0, "rest_settle_s": 0.2}
    with small_daemon(tmp_path, sensor_px=320, virtual=False) as daemon:
        done(daemon, "home")
        job = daemon.submit(recipe("inflation", inflation=given), "test")
        assert stuck.wait(WAIT_S)
        until(lambda: daemon.job(job.id).progress.done > 20, "frames that wait for the disk")
        desk = daemon.job(job.id).model_copy(update={"place": "desk"})
        working = threading.Event()

        def busy():
            while not working.wait(0.05):
                daemon.engine.shop._progress(desk, Progress(1, 2, "at the desk"), "images", "")

        thread = threading.Thread(target=busy)
        thread.start()
        assert counted(daemon, "recorder", 1.5) == 0
        assert counted(daemon, "engine", 0.5) > 0  # the procedure goes on: lost frames are counted
        go.set()
        until(lambda: counted(daemon, "recorder", 0.3) > 0, "the recorder")
        working.set()
        thread.join()
        daemon.stop_job(job.id, "test")
        ended(daemon, job)


def test_a_procedure_that_stands_still_while_frames_come_is_told(tmp_path):
    given = {"rest_frames": 3, "ramp_s": 10.0, "hold_s": 1.0, "top_kpa": 2.0, "rest_settle_s": 0.2}
    with small_daemon(tmp_path, sensor_px=320, virtual=False) as daemon:
        done(daemon, "home")
        job = daemon.submit(recipe("inflation", inflation=given), "test")
        until(lambda: (p := daemon.job(job.id).progress) is not None and p.done > 10, "frames")
        assert counted(daemon, "engine", 0.5) > 0
        go, source = threading.Event(), daemon.bench.drivers["pressure"]
        readings = source.read
        source.read = lambda: (go.wait(WAIT_S), readings())[1]
        counted(daemon, "engine", 0.5)  # what it was about
        assert counted(daemon, "engine", 1.5) == 0
        go.set()
        source.read = readings
        daemon.stop_job(job.id, "test")
        ended(daemon, job)


def test_a_question_after_a_burst_is_waited_for_in_good_health(tmp_path):
    given = {"rest_frames": 3, "ramp_s": 20.0, "hold_s": 1.0, "top_kpa": 8.0, "rest_settle_s": 0.2}
    steps = [
        {"name": "i", "do": {"recipe": "inflation", "specimen": None, "inflation": given}},
        {"name": "h", "do": {"recipe": "home", "prompt": "is the membrane away?"}},
    ]
    with small_daemon(tmp_path, sensor_px=320, virtual=False, attended=True) as daemon:
        done(daemon, "home")
        job = daemon.submit(recipe("campaign", steps=steps), "test")
        until(lambda: (p := daemon.job(job.id).progress) is not None and p.done > 40, "pressure")
        source = daemon.bench.drivers["pressure"]
        source.set_pressure = lambda kpa: None
        source.vent()  # as a membrane that bursts
        until(lambda: daemon.job(job.id).status is JobStatus.WAITING, "the question")
        assert daemon.job(job.id).progress is None
        before = {name: counter() for name, counter in daemon.progress().items()}
        time.sleep(1.5)
        assert all(counter() > before[name] for name, counter in daemon.progress().items())
        daemon.stop_job(job.id, "test")
        ended(daemon, job)
