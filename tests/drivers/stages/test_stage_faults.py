"""Each driver, on each line, with each fault: a named error in time, recovery, and never a false position."""

import socket
import time
from itertools import product

import numpy as np
import pytest
import serial

from drivers.clock import HostClock
from drivers.emulators.wire import WireFault
from drivers.errors import (
    DeviceBusyError,
    DeviceFaultError,
    DeviceTimeoutError,
    NotConnectedError,
    NotHomedError,
    ProtocolError,
)
from drivers.simulated import Fault
from tests.drivers.contract.outcome import Outcome
from tests.drivers.stages.faulty import (
    LONGEST_CALL_S,
    ONE_LINE_EACH,
    RIGS,
    SHORT_S,
    patiently,
    rig,
    within_its_timeout,
)
from tests.drivers.stages.rigs import SPEED, ximc_axis, zaber_axis

RESOLUTION = 1e-4
ERRORS = {
    WireFault.SILENCE: DeviceTimeoutError,
    WireFault.LATE: DeviceTimeoutError,
    WireFault.PARTIAL: DeviceTimeoutError,
    WireFault.GARBLED: ProtocolError,
}


@pytest.fixture(params=RIGS, ids="-".join)
def here(request):
    with rig(*request.param) as built:
        yield built


@pytest.fixture(params=ONE_LINE_EACH, ids="-".join)
def one(request):
    with rig(*request.param, absolute=True, answer_timeout_s=SHORT_S) as built:
        yield built


@pytest.fixture(params=ONE_LINE_EACH, ids="-".join)
def calm(request):
    with rig(*request.param, absolute=True) as built:
        yield built


def true(here) -> bool:
    """Whether the axis tells where it is, and that it is sure of it."""
    status = patiently(here.axis.status)
    return status.homed and abs(status.position - here.truth()) < RESOLUTION


@pytest.mark.parametrize(
    ("command", "fault"),
    [*product(("status", "move_to"), WireFault), *product(("home", "stop"), (WireFault.SILENCE,))],
)
def test_a_fault_of_the_wire(one, fault, command):
    call = {
        "status": one.axis.status,
        "move_to": lambda: one.axis.move_to(1.0),
        "home": one.axis.home,
        "stop": one.axis.stop,
    }[command]
    one.emulator.faults.inject(fault)
    for _ in range(2 if command == "status" else 1):
        with pytest.raises(ERRORS[fault], match=r"^stage: "):
            within_its_timeout(call)
    one.emulator.faults.clear()
    if command == "home":
        patiently(one.axis.home)
    assert true(one)
    patiently(lambda: one.axis.move_to(0.2))
    assert true(one)
    assert one.truth() == pytest.approx(0.2, abs=RESOLUTION)


@pytest.mark.parametrize("fault", [WireFault.SILENCE, WireFault.GARBLED, WireFault.PARTIAL])
@pytest.mark.parametrize("maker_and_line", ONE_LINE_EACH, ids="-".join)
def test_one_fault_is_made_good(maker_and_line, fault):
    with rig(*maker_and_line, absolute=True, answer_timeout_s=0.4) as here:
        here.emulator.faults.inject(fault, count=1)
        assert here.axis.status().position == pytest.approx(here.truth(), abs=RESOLUTION)
        here.emulator.faults.inject(fault, count=1)
        here.axis.move_to(0.3)
        assert true(here)


def test_a_late_answer_is_not_taken_for_the_next_one(one):
    motor = one.stage.carriages[0]
    one.emulator.faults.late_s = 0.5
    one.emulator.faults.inject(WireFault.LATE, count=1)
    began_s = time.monotonic()
    try:
        told = within_its_timeout(one.axis.status).position
        assert told == pytest.approx(one.truth(), abs=RESOLUTION)
    except DeviceTimeoutError:
        pass
    # elsewhere by the time that the late answer is there
    motor.drive_to(5.0, SPEED)
    while motor.state().remaining_s or time.monotonic() < began_s + 0.6:
        HostClock().sleep(0.02)
    for _ in range(3):
        assert true(one)


@pytest.mark.parametrize("maker", ["ximc", "zaber"])
def test_no_position_is_false_while_it_moves_and_the_wire_fails(maker):
    rng = np.random.default_rng(20130521)
    told, failed = 0, 0
    with rig(maker, "tcp", absolute=True, answer_timeout_s=0.03) as here:
        here.emulator.faults.late_s = 0.05
        motor = here.stage.carriages[0]
        motor.drive_to(17.0, SPEED)
        while (low := here.truth()) < 15.0:
            if rng.random() < 0.5:
                here.emulator.faults.inject(rng.choice(list(WireFault)), count=int(rng.integers(1, 4)))
            try:
                position = here.axis.status().position
            except (DeviceTimeoutError, ProtocolError):
                failed += 1
                continue
            told += 1
            assert low - RESOLUTION <= position <= here.truth() + RESOLUTION
        here.emulator.faults.clear()
        while motor.state().remaining_s:
            HostClock().sleep(0.02)
        assert true(here)
    assert told > 10
    assert failed > 0


@pytest.mark.parametrize("fault", WireFault)
def test_a_fault_on_the_way(one, fault):
    Outcome(HostClock(), 0.15, lambda: one.emulator.faults.inject(fault))
    with pytest.raises(ERRORS[fault], match=r"^stage: moving to 5"):
        within_its_timeout(lambda: one.axis.move_to(5.0), 0.15 + LONGEST_CALL_S)
    one.emulator.faults.clear()
    patiently(one.axis.stop)
    motor = one.stage.carriages[0]
    while motor.state().remaining_s:
        HostClock().sleep(0.02)
    assert true(one)
    patiently(lambda: one.axis.move_to(one.truth() - 0.3))
    assert true(one)


def test_unplugged_at_rest(here):
    here.emulator.stop()
    assert not within_its_timeout(here.axis.status).connected
    for call in (lambda: here.axis.move_to(1.0), here.axis.home, here.axis.info, here.axis.connect):
        with pytest.raises(NotConnectedError, match=r"^stage: "):
            within_its_timeout(call)
    here.axis.stop()
    here.emulator.start()
    here.axis.connect()
    assert true(here)
    here.axis.move_to(1.0)


def test_unplugged_on_the_way(here):
    outcome = Outcome(HostClock(), 0.2, here.emulator.stop)
    with pytest.raises(NotConnectedError, match=r"^stage: moving to 5 mm: the (port|connection) is gone"):
        within_its_timeout(lambda: here.axis.move_to(5.0), 0.2 + LONGEST_CALL_S)
    outcome.get()
    assert not here.axis.status().connected
    here.emulator.start()
    here.axis.connect()
    here.axis.stop()
    while here.axis.status().moving:
        HostClock().sleep(0.02)
    assert true(here)
    here.axis.move_to(here.truth() - 0.3)


def test_a_power_cycle_at_rest(here):
    here.axis.move_to(2.0)
    here.emulator.power_cycle()
    assert not within_its_timeout(here.axis.status).connected
    here.axis.connect()
    assert not here.axis.status().homed
    with pytest.raises(NotHomedError):
        here.axis.move_to(1.0)
    assert here.truth() == pytest.approx(2.0, abs=RESOLUTION)
    here.axis.home()
    here.axis.move_to(1.0)
    assert true(here)


def test_a_power_cycle_that_the_line_survives(here):
    here.axis.move_to(2.0)
    here.restart_behind_the_line()
    assert not here.axis.status().homed
    with pytest.raises(NotHomedError):
        here.axis.move_to(1.0)
    here.axis.home()
    here.axis.move_to(1.0)
    assert true(here)


def test_a_power_cycle_on_the_way(here):
    outcome = Outcome(HostClock(), 0.2, here.restart_behind_the_line)
    with pytest.raises(DeviceFaultError, match="no longer knows where it is"):
        here.axis.move_to(5.0)
    outcome.get()
    assert not here.axis.status().homed
    here.axis.home()
    here.axis.move_to(1.0)
    assert true(here)


def test_switched_off_and_on_between_two_moves():
    """The controller's own word that it is homed does not count when its settings are no longer ours."""
    with rig("ximc", "tcp", absolute=True, microsteps=32) as here:
        here.axis.move_to(2.0)
        here.restart_behind_the_line()
        with pytest.raises(NotHomedError, match="switched off in between"):
            here.axis.move_to(1.0)
        assert not here.axis.status().homed
        assert here.truth() == pytest.approx(2.0, abs=RESOLUTION)
        here.axis.home()
        here.axis.move_to(1.0)
        assert true(here)


def test_another_program_has_the_port(here):
    here.axis.close()
    address = here.emulator.address
    if address.startswith("tcp:"):
        host, _, port = address.removeprefix("tcp://").partition(":")
        other = socket.create_connection((host, int(port)))
    else:
        other = serial.Serial(address, exclusive=True)
    with pytest.raises(DeviceBusyError, match=r"^stage: connecting.*another program"):
        within_its_timeout(here.axis.connect)
    assert not here.axis.status().connected
    other.close()
    here.axis.connect()
    assert true(here)


@pytest.mark.parametrize("fault", WireFault)
def test_a_fault_while_connecting(one, fault):
    one.axis.close()
    one.emulator.faults.inject(fault)
    error = ProtocolError if fault is WireFault.GARBLED else NotConnectedError
    with pytest.raises(error, match=r"^stage: connecting"):
        within_its_timeout(one.axis.connect)
    assert not one.axis.status().connected
    one.emulator.faults.clear()
    patiently(one.axis.connect)
    assert true(one)


@pytest.mark.parametrize(
    ("fault", "error", "words"),
    [
        (Fault.STALLED_MOVE, DeviceFaultError, "stalled"),
        (Fault.LIMIT_HIT, DeviceFaultError, "limit switch hit"),
        (Fault.HANGING_MOVE, DeviceTimeoutError, "not there within"),
    ],
)
def test_a_fault_of_the_stage(calm, fault, error, words):
    outcome = Outcome(HostClock(), 0.1, lambda: calm.stage.faults.inject(fault, count=1))
    with pytest.raises(error, match=f"^stage: moving to 4 mm: .*{words}"):
        calm.axis.move_to(4.0)
    outcome.get()
    status = calm.axis.status()
    assert not status.moving
    assert status.position == pytest.approx(calm.truth(), abs=RESOLUTION)
    assert bool(status.fault) == (error is DeviceFaultError)
    calm.axis.move_to(calm.truth() - 0.3)
    assert true(calm)
    assert calm.axis.status().fault == ""


def test_moving_on_its_own(calm):
    """By its buttons, say."""
    calm.stage.carriages[0].drive_to(8.0, SPEED)
    for call in (lambda: calm.axis.move_to(1.0), calm.axis.home):
        with pytest.raises(DeviceBusyError, match="it still moves"):
            call()
    calm.axis.stop()
    while calm.axis.status().moving:
        HostClock().sleep(0.02)
    calm.axis.move_to(1.0)


def test_not_there(tmp_path):
    for build in (ximc_axis, zaber_axis):
        for address in (f"{tmp_path}/ttyUSB7", "tcp://127.0.0.1:1"):
            with pytest.raises(NotConnectedError, match=r"no port|no connection"):
                build("mm", address).connect()
