"""The e-stop: in every state, past queue and locks, latched; also when a motion slips through as it closes."""

import http.client
import json
import threading
import time

import pytest

from bscd.daemon.documents import JobStatus, RigState
from bscd.daemon.errors import EmergencyStoppedError, IllegalRequestError
from bscd.daemon.estop import EmergencyStop
from bscd.daemon.estop_listener import EStopListener
from bscd.daemon.guards import Latch
from drivers.errors import NotConnectedError
from tests.daemon.small import ended, recipe, small_daemon, until

SLOW = {"\nspeed_mm_s = 20.0": "\nhomed_at_start = true\nspeed_mm_s = 0.5"}


def at_rest_and_vented(daemon):
    pressure = daemon.bench.rig.pressure
    return not any(axis.status().moving for axis in daemon.bench.rig.axes.values()) and pressure.set_point_kpa() == 0.0


STATES = ["offline", "connecting", "idle", "moving", "waiting", "pausing", "paused", "stopping", "fault", "e-stopped"]


@pytest.mark.parametrize("state", STATES)
def test_in_every_state_it_stops_vents_and_latches(tmp_path, state):
    with small_daemon(
        tmp_path, sensor_px=320, virtual=False, attended=True, connected=state != "offline", changes=SLOW
    ) as daemon:
        job, slow, connecting = None, threading.Event(), None
        if state != "offline":
            daemon.bench.rig.pressure.set_pressure(5.0)
        if state in ("moving", "pausing", "stopping"):
            job = daemon.submit(recipe("move", axis="jacks", position=80.0), "test")
            until(lambda: daemon.bench.rig.jacks.status().moving, "the move")
            if state != "moving":
                ask = daemon.pause_job if state == "pausing" else daemon.stop_job
                ask(job.id, "test")  # a move has no safe point before its end
                assert daemon.states.state.value == state
        elif state == "connecting":
            daemon.disconnect("test")
            connect = daemon.bench.drivers["rotation"].connect
            daemon.bench.drivers["rotation"].connect = lambda: (slow.wait(30.0), connect())
            connecting = threading.Thread(target=daemon.connect, args=("test",))
            connecting.start()
            until(lambda: daemon.states.state is RigState.CONNECTING, "connecting")
        elif state in ("waiting", "paused"):
            job = daemon.submit(recipe("home", prompt="hands off?"), "test")
            until(lambda: daemon.job(job.id).status is JobStatus.WAITING, "the question")
            if state == "paused":
                daemon.pause_job(job.id, "test")
                until(lambda: daemon.states.state is RigState.PAUSED, "the pause")
        elif state == "fault":
            daemon.bench.drivers["rotation"].close()
            until(lambda: daemon.states.state is RigState.FAULT, "the fault")
        elif state == "e-stopped":
            daemon.estop.trigger("before")
        told = daemon.estop.trigger("anna", "it smells")
        assert told.latched
        assert told.by == "anna: it smells"
        assert daemon.states.state is RigState.ESTOPPED
        slow.set()
        if connecting is not None:
            connecting.join(30.0)
            assert daemon.states.state is RigState.ESTOPPED
        if state != "offline":
            until(lambda: at_rest_and_vented(daemon), "rest")
        if job is not None:
            over = ended(daemon, job)
            assert over.status is JobStatus.ABORTED
            assert "e-stop by anna" in over.reason
        if state not in ("offline", "connecting", "fault", "e-stopped"):
            assert told.failures == ()
        with pytest.raises(IllegalRequestError, match="the state is e-stopped, allowed now: estop, reset"):
            daemon.submit(recipe("home"), "test")
        with pytest.raises(EmergencyStoppedError, match="jacks: a move to 10 refused, the e-stop is latched"):
            daemon.bench.rig.jacks.move_to(10.0)
        with pytest.raises(EmergencyStoppedError, match="a set-point of 3 kPa refused"):
            daemon.bench.rig.pressure.set_pressure(3.0)
        before = {} if state in ("offline", "fault") else daemon.bench.rig.jacks.status().position
        daemon.reset_estop("bert")
        assert daemon.states.state is RigState.IDLE
        assert not daemon.estop.document().latched
        assert at_rest_and_vented(daemon)
        if before != {}:
            assert daemon.bench.rig.jacks.status().position == before
        assert [line.action for line in daemon.journal.audits()][:1] == ["e-stop"]


def test_it_waits_for_no_device_and_tells_which_did_not_stop():
    given, stuck = [], threading.Event()
    commands = {
        "stuck": lambda: stuck.wait(30.0),
        "lost": lambda: (_ for _ in ()).throw(NotConnectedError("lost", "stopping: it is gone")),
        "well": lambda: given.append(time.monotonic()),
        "mistake": lambda: 1 / 0,
    }
    estop = EmergencyStop(Latch(), commands)
    try:
        begun = time.monotonic()
        told = estop.trigger("test")
        assert given[0] - begun < 1.0
        assert any("stuck: its stop command was not given" in failure for failure in told.failures)
        assert any("lost: stopping: it is gone" in failure for failure in told.failures)
        assert any("mistake: ZeroDivisionError" in failure for failure in told.failures)
        assert not any("well" in failure for failure in told.failures)
    finally:
        stuck.set()
        estop.close()


def test_a_motion_that_was_let_through_just_before_is_stopped_again():
    latch, stops, moving = Latch(), [], threading.Event()
    estop = EmergencyStop(latch, {"jacks": lambda: stops.append(moving.is_set())})
    try:
        with latch.motion("jacks", "a move"):  # let through, and slow to begin
            estop.trigger("test")
            moving.set()
            until(lambda: stops[-1], "a stop after the motion began")
        count = len(stops)
        until(lambda: not latch.under_way("jacks"), "its end")
        assert count >= 2
        with pytest.raises(EmergencyStoppedError), latch.motion("jacks", "a move"):
            pass
        assert estop.reset(estop.triggers())
        with latch.motion("jacks", "a move"):
            assert latch.under_way("jacks")
    finally:
        estop.close()


def test_many_triggers_at_once_all_stop():
    stops = []
    estop = EmergencyStop(Latch(), {"a": lambda: stops.append("a"), "b": lambda: stops.append("b")})
    threads = [threading.Thread(target=estop.trigger, args=("test",)) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30.0)
    estop.close()
    assert {"a", "b"} <= set(stops)
    assert estop.latched


@pytest.fixture
def listener():
    estop = EmergencyStop(Latch(), {"jacks": lambda: None})
    serving = EStopListener(estop, "127.0.0.1", 0, lambda key: "anna" if key == "right" else None)
    yield estop, serving.port
    serving.close()
    estop.close()


def ask(port, method, path, key=""):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)
    try:
        connection.request(method, path, headers={"Authorization": f"Bearer {key}"} if key else {})
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())
    finally:
        connection.close()


def test_its_own_listener(listener):
    estop, port = listener
    assert ask(port, "POST", "/estop")[0] == 401
    assert ask(port, "POST", "/other", "right")[0] == 404
    assert not estop.latched
    status, told = ask(port, "POST", "/estop", "right")
    assert (status, told["latched"]) == (200, True)
    assert estop.latched
    assert ask(port, "GET", "/estop")[0] == 401
    assert ask(port, "GET", "/estop", "right")[1]["latched"] is True


def test_a_client_that_says_nothing_keeps_nobody_waiting(listener):
    port = listener[1]
    connections = [http.client.HTTPConnection("127.0.0.1", port, timeout=10.0) for _ in range(8)]
    for connection in connections:
        connection.connect()  # and never asks
    assert ask(port, "POST", "/estop", "right")[0] == 200
    for connection in connections:
        connection.close()
