"""Whatever fails: the membrane is vented, a rig that is not whole takes no jobs, and the latch holds."""

import threading
import time

import pytest

from bscd.daemon.documents import JobStatus, RigState
from bscd.daemon.errors import EmergencyStoppedError, IllegalRequestError, InterlockError
from bscd.procedures import RigNotReadyError
from drivers.errors import NotConnectedError
from tests.daemon.small import done, ended, recipe, small_daemon, until

SLOW = {"\nspeed_mm_s = 20.0": "\nhomed_at_start = true\nspeed_mm_s = 0.5"}
INFLATION = {"rest_frames": 3, "ramp_s": 20.0, "hold_s": 1.0, "top_kpa": 8.0, "rest_settle_s": 0.2}


def lose(device, *methods):
    """From now on the device does not answer."""

    def gone(*_):
        raise NotConnectedError(device.name, "asking: it does not answer")

    for method in methods:
        setattr(device, method, gone)


def test_a_job_at_the_desk_that_is_aborted_leaves_the_bench_alone(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, virtual=False, changes=SLOW) as daemon:
        for name in ("a", "b"):
            daemon.files.new("run", name).write_text("a process of its own finds out that this is no run")
        daemon.bench.rig.pressure.set_pressure(5.0)
        move = daemon.submit(recipe("move", axis="jacks", position=10.0), "test")
        until(lambda: daemon.bench.rig.jacks.status().moving, "the move")
        desk = daemon.submit(recipe("calibrate", reference="a", bsc="b"), "test")
        until(lambda: daemon.job(desk.id).status is JobStatus.RUNNING, "the desk")
        daemon.abort_job(desk.id, "anna", "the wrong run")
        assert ended(daemon, desk).status is JobStatus.ABORTED
        assert daemon.job(move.id).status is JobStatus.RUNNING
        assert daemon.bench.rig.jacks.status().moving
        assert daemon.bench.rig.pressure.set_point_kpa() == 5.0
        daemon.abort_job(move.id, "anna", "enough")
        ended(daemon, move)


@pytest.mark.parametrize("lost", ["primary", "rotation"])
def test_a_rig_that_does_not_connect_is_vented_all_the_same(tmp_path, lost):
    with small_daemon(tmp_path, sensor_px=320, connected=False) as daemon:
        source = daemon.bench.drivers["pressure"]
        source.connect()
        source.set_pressure(5.0)  # as an earlier daemon left it
        lose(daemon.bench.drivers[lost], "connect")
        with pytest.raises(RigNotReadyError, match=f"1 of 6 devices failed: {lost}"):
            daemon.connect("test")
        assert daemon.states.state is RigState.FAULT
        assert source.set_point_kpa() == 0.0


def test_a_vent_that_fails_when_connecting_says_what_to_do(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, connected=False) as daemon:
        lose(daemon.bench.drivers["pressure"], "vent")
        with pytest.raises(RigNotReadyError, match="pressure: asking: it does not answer"):
            daemon.connect("test")
        assert daemon.states.state is RigState.FAULT
        assert "open the valve by hand" in daemon.states.reason


def test_a_pressure_source_that_is_lost_in_an_inflation_is_a_fault(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, virtual=False) as daemon:
        done(daemon, "home")
        job = daemon.submit(recipe("inflation", specimen=None, inflation=INFLATION), "test")
        until(lambda: (p := daemon.job(job.id).progress) is not None and p.done > 10, "frames")
        lose(daemon.bench.drivers["pressure"], "read", "vent", "set_pressure", "readings_since", "info")
        over = ended(daemon, job)
        assert over.status is JobStatus.FAILED
        assert "open the valve by hand" in over.reason
        until(lambda: daemon.states.state is RigState.FAULT, "the fault")
        assert "pressure: not connected any more" in daemon.states.reason
        assert daemon.ready()[0] is False


def test_a_pressure_source_that_is_lost_at_rest_is_a_fault(tmp_path):
    with small_daemon(tmp_path, sensor_px=320) as daemon:
        done(daemon, "home")
        until(lambda: daemon.states.state is RigState.IDLE, "a rig at rest")
        daemon.states.send("start")  # so that the loss is no news once the rig is idle again
        lose(daemon.bench.drivers["pressure"], "read")
        until(lambda: not daemon.devices()["pressure"].connected, "a look")
        with pytest.raises(InterlockError, match="pressure: is not connected"):
            daemon.submit(recipe("inflation", specimen=None, inflation=INFLATION), "test")
        daemon.states.send("finish")
        until(lambda: daemon.states.state is RigState.FAULT, "the fault")
        assert "pressure: asking: it does not answer" in daemon.states.reason


def test_an_e_stop_in_the_middle_of_a_reset_holds(tmp_path):
    with small_daemon(tmp_path, sensor_px=320) as daemon:
        daemon.estop.trigger("anna")
        send = daemon.states.send

        def meanwhile(event, reason=""):
            if event == "reset":
                daemon.estop.trigger("bert")
            return send(event, reason)

        daemon.states.send = meanwhile
        with pytest.raises(IllegalRequestError, match="it was triggered again"):
            daemon.reset_estop("carla")
        daemon.states.send = send
        assert daemon.states.state is RigState.ESTOPPED
        assert daemon.estop.latched
        assert daemon.estop.document().latched
        with pytest.raises(EmergencyStoppedError):
            daemon.bench.rig.jacks.home()
        daemon.reset_estop("carla")
        assert daemon.states.state is RigState.IDLE
        assert not daemon.estop.latched


def test_a_reset_does_not_overtake_an_e_stop_that_is_under_way(tmp_path):
    with small_daemon(tmp_path, sensor_px=320) as daemon:
        daemon.estop.trigger("anna")
        slow, begun = threading.Event(), threading.Event()
        vent = daemon.estop._devices[0]._command

        def slowly():
            begun.set()
            slow.wait(10.0)
            vent()

        daemon.estop._devices[0]._command = slowly
        trigger = threading.Thread(target=daemon.estop.trigger, args=("bert",))
        trigger.start()
        assert begun.wait(10.0)
        with pytest.raises(IllegalRequestError, match="an e-stop is under way"):
            daemon.reset_estop("carla")
        assert daemon.estop.latched
        slow.set()
        trigger.join(10.0)
        assert daemon.states.state is RigState.ESTOPPED
        daemon.reset_estop("carla")
        assert not daemon.estop.document().latched


def test_a_slow_device_keeps_nobody_from_stopping_a_job(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, virtual=False, changes=SLOW) as daemon:
        job = daemon.submit(recipe("move", axis="jacks", position=10.0), "test")
        until(lambda: daemon.bench.rig.jacks.status().moving, "the move")
        asked, go = threading.Event(), threading.Event()
        info = daemon.bench.drivers["rotation"].info

        def slowly():
            asked.set()
            go.wait(10.0)
            return info()

        daemon.bench.drivers["rotation"].info = slowly

        def submit():
            with pytest.raises(InterlockError, match="rotation: not homed"):
                daemon.submit(recipe("move", axis="rotation", position=1.0), "test")

        submitting = threading.Thread(target=submit)
        submitting.start()
        assert asked.wait(10.0)
        begun = time.monotonic()
        daemon.abort_job(job.id, "anna", "now")
        assert time.monotonic() - begun < 5.0  # the device takes ten
        go.set()
        submitting.join(10.0)
        assert ended(daemon, job).status is JobStatus.ABORTED
