"""Every injected fault ends in its named error within its time-out, and is over when it is cleared."""

import pytest

from drivers.errors import DeviceFaultError, DeviceTimeoutError, NotConnectedError, UnsupportedError
from drivers.registry import DriverContext
from drivers.simulated import (
    Fault,
    Faults,
    JackOptions,
    RotationOptions,
    SimulatedAxis,
    SimulatedCamera,
    SimulatedCameraOptions,
    SimulatedPressure,
    SimulatedPressureOptions,
    TranslationOptions,
)

ANSWER_TIMEOUT_S = 0.7


def build_device(kind, clock, world):
    context = DriverContext(kind, clock, world)
    if kind == "camera":
        return SimulatedCamera(SimulatedCameraOptions(answer_timeout_s=ANSWER_TIMEOUT_S), context)
    if kind == "pressure":
        return SimulatedPressure(SimulatedPressureOptions(answer_timeout_s=ANSWER_TIMEOUT_S), context)
    return SimulatedAxis(TranslationOptions(answer_timeout_s=ANSWER_TIMEOUT_S, homed_at_start=True), context)


COMMANDS = {
    "camera": {
        "info": lambda camera: camera.info(),
        "status": lambda camera: camera.status(),
        "configure": lambda camera: camera.configure(gain_db=1.0),
        "snap": lambda camera: camera.snap(),
        "start": lambda camera: camera.start(),
    },
    "axis": {
        "info": lambda axis: axis.info(),
        "status": lambda axis: axis.status(),
        "home": lambda axis: axis.home(),
        "move_to": lambda axis: axis.move_to(60.0),
        "stop": lambda axis: axis.stop(),
    },
    "pressure": {
        "info": lambda source: source.info(),
        "read": lambda source: source.read(),
        "set_point_kpa": lambda source: source.set_point_kpa(),
        "set_pressure": lambda source: source.set_pressure(1.0),
        "vent": lambda source: source.vent(),
    },
}


@pytest.mark.parametrize(("kind", "command"), [(kind, name) for kind, calls in COMMANDS.items() for name in calls])
def test_no_answer_to_a_command(clock, world, kind, command):
    device = build_device(kind, clock, world)
    device.connect()
    device.faults.inject(Fault.NO_ANSWER)
    began_s = clock.now_s()
    with pytest.raises(DeviceTimeoutError, match=f"{kind}: .*no answer within 0.7 s"):
        COMMANDS[kind][command](device)
    assert clock.now_s() - began_s == pytest.approx(ANSWER_TIMEOUT_S)
    device.faults.clear(Fault.NO_ANSWER)
    COMMANDS[kind][command](device)
    device.close()


@pytest.mark.parametrize("kind", ["camera", "axis", "pressure"])
def test_no_answer_while_connecting_and_closing(clock, world, kind):
    device = build_device(kind, clock, world)
    device.faults.inject(Fault.NO_ANSWER)
    with pytest.raises(NotConnectedError, match="check its power"):
        device.connect()
    assert clock.now_s() == pytest.approx(ANSWER_TIMEOUT_S)
    device.faults.clear()
    device.connect()
    device.faults.inject(Fault.NO_ANSWER)
    device.close()
    device.close()


def test_one_lost_answer_ends_by_itself(clock, world):
    device = build_device("pressure", clock, world)
    device.connect()
    device.faults.inject(Fault.NO_ANSWER, count=2)
    for _ in range(2):
        with pytest.raises(DeviceTimeoutError):
            device.read()
    assert abs(device.read().pressure_kpa) < 0.1


def test_an_axis_that_falls_silent_moves_on(clock, world):
    axis = build_device("axis", clock, world)
    axis.connect()
    clock.call_at(1.0, lambda: axis.faults.inject(Fault.NO_ANSWER))
    with pytest.raises(DeviceTimeoutError, match="no answer"):
        axis.move_to(100.0)
    there_mm = world.now("translation_mm")
    assert clock.now_s() == pytest.approx(1.0 + ANSWER_TIMEOUT_S, abs=0.05)
    clock.sleep(1.0)
    assert world.now("translation_mm") == pytest.approx(there_mm + 5.0, abs=0.01)
    axis.faults.clear()
    axis.stop()
    clock.sleep(1.0)
    assert not axis.status().moving


def test_a_silent_axis_is_not_stopped_by_closing(clock, world):
    axis = build_device("axis", clock, world)
    axis.connect()
    clock.call_at(1.0, lambda: axis.faults.inject(Fault.NO_ANSWER))
    with pytest.raises(DeviceTimeoutError):
        axis.move_to(100.0)
    axis.close()
    clock.sleep(20.0)
    assert world.now("translation_mm") == pytest.approx(100.0, abs=0.01)


AXES = {
    "rotation": (RotationOptions(homed_at_start=True), "rotation_deg", 90.0),
    "translation": (TranslationOptions(homed_at_start=True), "translation_mm", 80.0),
    "jack": (JackOptions(homed_at_start=True), "jack_mm", 20.0),
}


@pytest.fixture(params=AXES)
def moving(request, clock, world):
    """An axis, its target, the middle of its start and its target, and where it truly is."""
    options, quantity, target = AXES[request.param]
    axis = SimulatedAxis(options, DriverContext(request.param, clock, world))
    axis.connect()
    start = world.now(quantity)
    return axis, target, (start + target) / 2.0, lambda: world.now(quantity)


@pytest.mark.parametrize(
    ("fault", "error", "words"),
    [
        (Fault.STALLED_MOVE, DeviceFaultError, "motor stalled"),
        (Fault.LIMIT_HIT, DeviceFaultError, "limit switch hit"),
        (Fault.HANGING_MOVE, DeviceTimeoutError, "not there within"),
    ],
)
def test_a_fault_on_the_way(clock, moving, fault, error, words):
    axis, target, middle, truth = moving
    duration_s = axis.move_duration_s(target)
    clock.call_at(duration_s / 2.0, lambda: axis.faults.inject(fault))
    with pytest.raises(error, match=f"{axis.name}: moving to {target:g}.*{words}"):
        axis.move_to(target)
    assert duration_s / 2.0 < clock.now_s() <= 1.5 * duration_s + 2.0 + 1e-6
    if error is DeviceTimeoutError:
        assert clock.now_s() == pytest.approx(1.5 * duration_s + 2.0)
    assert truth() == pytest.approx(middle, abs=0.03 * abs(target - truth()) + 0.5)
    here = truth()
    clock.sleep(60.0)
    assert truth() == here
    status = axis.status()
    assert not status.moving
    assert status.fault == (words if error is DeviceFaultError else "")
    with pytest.raises(error, match=words):
        axis.move_to(target)
    axis.faults.clear(fault)
    axis.move_to(target)
    assert axis.status().position == pytest.approx(target, abs=axis.info().resolution)
    assert axis.status().fault == ""


@pytest.mark.parametrize("fault", [Fault.STALLED_MOVE, Fault.LIMIT_HIT])
def test_a_fault_while_homing_leaves_the_axis_not_homed(clock, moving, fault):
    axis, *_ = moving
    clock.call_at(1.0, lambda: axis.faults.inject(fault, count=1))
    with pytest.raises(DeviceFaultError, match=f"{axis.name}: homing"):
        axis.home()
    assert not axis.status().homed
    axis.home()
    assert axis.status().homed


def test_one_jack_at_its_limit_stops_the_other(clock, world):
    axis = SimulatedAxis(JackOptions(homed_at_start=True), DriverContext("jack", clock, world))
    axis.connect()
    clock.call_at(5.0, lambda: axis.faults.inject(Fault.LIMIT_HIT, count=1))
    with pytest.raises(DeviceFaultError, match="limit switch hit"):
        axis.move_to(10.0)
    heights_mm = [carriage.true_position() for carriage in axis.carriages]
    # from 35 mm each at 2 mm/s: 9.5 mm after 5 s; the one that is not at its limit brakes over 0.5 mm
    assert heights_mm[0] == pytest.approx(25.5, abs=0.1)
    assert heights_mm[1] == pytest.approx(25.0, abs=0.1)


@pytest.mark.parametrize("fault", [Fault.DROPPED_FRAME, Fault.NO_ANSWER])
def test_no_frame_of_a_stream_arrives(clock, world, fault):
    camera = build_device("camera", clock, world)
    camera.connect()
    camera.start()
    camera.read()
    camera.faults.inject(fault)
    began_s = clock.now_s()
    with pytest.raises(DeviceTimeoutError, match="none came within 2 s"):
        camera.read(timeout_s=2.0)
    assert clock.now_s() - began_s == pytest.approx(2.0)
    camera.faults.clear(fault)
    camera.read()
    status = camera.status()
    assert status.delivered_frames == 2
    assert status.lost_frames == 22
    camera.close()


def test_a_dropped_snap(clock, world):
    camera = build_device("camera", clock, world)
    camera.connect()
    first = camera.snap().frame_id
    camera.faults.inject(Fault.DROPPED_FRAME, count=1)
    began_s = clock.now_s()
    with pytest.raises(DeviceTimeoutError, match="none came within 3 s"):
        camera.snap(timeout_s=3.0)
    assert clock.now_s() - began_s == pytest.approx(3.0)
    assert camera.status().lost_frames == 1
    assert camera.snap().frame_id == first + 2


def test_a_short_snap_does_not_wait_for_the_answer_timeout(clock, world):
    camera = build_device("camera", clock, world)
    camera.connect()
    camera.faults.inject(Fault.NO_ANSWER)
    with pytest.raises(DeviceTimeoutError):
        camera.snap(timeout_s=0.1)
    assert clock.now_s() == pytest.approx(0.1)


def test_faults_are_per_device(clock, world):
    camera, source = build_device("camera", clock, world), build_device("pressure", clock, world)
    camera.connect()
    source.connect()
    camera.faults.inject(Fault.NO_ANSWER)
    assert abs(source.read().pressure_kpa) < 0.1
    assert source.faults.active() == frozenset()


def test_a_device_has_only_faults_of_its_kind(clock, world):
    source = build_device("pressure", clock, world)
    with pytest.raises(UnsupportedError, match=r"pressure: .*'stalled_move'; it can have no_answer"):
        source.faults.inject(Fault.STALLED_MOVE)


def test_faults_are_counted_and_cleared():
    faults = Faults("device", Fault)
    assert not faults.strike(Fault.LIMIT_HIT)
    faults.inject(Fault.LIMIT_HIT, count=2)
    faults.inject(Fault.NO_ANSWER)
    assert faults.active() == {Fault.LIMIT_HIT, Fault.NO_ANSWER}
    assert [faults.strike(Fault.LIMIT_HIT) for _ in range(3)] == [True, True, False]
    assert all(faults.strike(Fault.NO_ANSWER) for _ in range(10))
    faults.clear(Fault.LIMIT_HIT)
    faults.clear()
    assert not faults.strike(Fault.NO_ANSWER)
    with pytest.raises(ValueError, match="at least once"):
        faults.inject(Fault.NO_ANSWER, count=0)
