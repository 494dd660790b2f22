"""Pulled plugs, power cuts, other programs and the drives' own faults end in named errors, and are over in time."""

import math
import time

import pytest

from drivers.clock import HostClock
from drivers.emulators.modbus.pdu import RefusedError
from drivers.errors import (
    DeviceBusyError,
    DeviceFaultError,
    DeviceTimeoutError,
    MoveStoppedError,
    NotConnectedError,
    NotHomedError,
)
from drivers.jacks.modbus import ModbusJacks
from drivers.registry import DriverContext
from drivers.simulated import Fault
from tests.drivers.contract.outcome import Outcome
from tests.drivers.jacks.rigs import (
    CALLS,
    FAST_MM_S,
    SPARE_S,
    TRANSPORTS,
    jack_rig,
    on_the_way,
    options,
    stands_at,
)


@pytest.fixture(params=TRANSPORTS)
def transport(request):
    return request.param


@pytest.fixture
def rig(transport):
    with jack_rig(transport, speed_mm_s=FAST_MM_S) as rig:
        yield rig


def test_unplugged_and_plugged_in_again(rig):
    jacks = rig.ready()
    jacks.move_to(6.0)
    rig.emulator.stop()
    status = jacks.status()
    assert (status.connected, status.homed) == (False, False)
    assert math.isnan(status.position)
    for call in ("home", "move_to", "move_duration_s", "stop"):
        began_s = time.monotonic()
        with pytest.raises(NotConnectedError, match="jack: "):
            CALLS[call](jacks)
        assert time.monotonic() - began_s < SPARE_S
    rig.emulator.start()
    assert stands_at(jacks, 6.0)
    jacks.move_to(20.0)
    assert rig.truth_mm() == pytest.approx(20.0, abs=0.02)


def test_unplugged_during_a_move(rig):
    jacks = rig.ready()
    pulled = on_the_way(rig, rig.emulator.stop)
    with pytest.raises(NotConnectedError, match="moving to 36 mm"):
        jacks.move_to(36.0)
    pulled.get()
    rig.emulator.start()
    time.sleep(jacks.move_duration_s(36.0) + 0.2)
    assert stands_at(jacks, rig.truth_mm())
    jacks.move_to(20.0)


def test_power_cycled_at_rest(rig):
    jacks = rig.ready()
    jacks.move_to(6.0)
    rig.emulator.power_cycle()
    with pytest.raises((NotHomedError, NotConnectedError)):
        jacks.move_to(20.0)
    assert not jacks.status().homed
    with pytest.raises(NotHomedError):
        jacks.move_to(20.0)
    jacks.home()
    assert rig.truth_mm() == pytest.approx(0.0, abs=0.02)
    jacks.move_to(20.0)
    assert rig.truth_mm() == pytest.approx(20.0, abs=0.02)


@pytest.mark.parametrize("target_mm", [0.0, 36.0])
def test_power_cycled_during_a_move(rig, target_mm):
    """0 mm is what the drives read after it: not taken for the target."""
    jacks = rig.ready()
    jacks.move_to(18.0)
    cycled = on_the_way(rig, rig.emulator.power_cycle)
    with pytest.raises((NotHomedError, NotConnectedError), match=f"moving to {target_mm:g} mm"):
        jacks.move_to(target_mm)
    cycled.get()
    assert not jacks.status().homed
    assert 0.5 < rig.truth_mm() < 35.9
    jacks.home()
    assert rig.truth_mm() == pytest.approx(0.0, abs=0.02)


def test_another_program_has_the_jacks(rig):
    rig.ready()
    other = ModbusJacks(options(rig.emulator.address), DriverContext("other", HostClock()))
    with pytest.raises(DeviceBusyError, match=r"other: .*end (the other|that) program"):
        other.connect()
    assert not other.status().connected
    rig.driver.close()
    other.connect()
    assert other.status().homed
    other.close()


@pytest.mark.parametrize("transport", ["rtu"], indirect=True)
@pytest.mark.parametrize(
    ("fault", "error", "words"),
    [
        (Fault.STALLED_MOVE, DeviceFaultError, r"overload: the motor stalled \(alarm 0x30\)"),
        (Fault.LIMIT_HIT, DeviceFaultError, r"limit switch hit \(alarm 0x66\)"),
        (Fault.HANGING_MOVE, DeviceTimeoutError, "not there within"),
    ],
)
def test_a_fault_of_a_drive(transport, fault, error, words):
    with jack_rig(transport, timeout_margin_s=10.0 if error is DeviceFaultError else 1.5) as rig:
        has_a_fault(rig, fault, error, words)


def has_a_fault(rig, fault, error, words):
    jacks = rig.ready()
    struck = on_the_way(rig, lambda: rig.simulated.faults.inject(fault))
    with pytest.raises(error, match=f"moving to 20 mm.*{words}"):
        jacks.move_to(20.0)
    struck.get()
    rig.simulated.faults.clear()
    time.sleep(0.2)
    status = jacks.status()
    assert not status.moving
    assert bool(status.fault) == (error is DeviceFaultError)
    assert stands_at(jacks, rig.truth_mm())
    jacks.move_to(4.0)
    assert jacks.status().fault == ""
    assert rig.truth_mm() == pytest.approx(4.0, abs=0.02)


@pytest.mark.parametrize("transport", ["rtu"], indirect=True)
def test_a_stop_before_the_first_poll_counts(rig):
    jacks = rig.ready()
    stop = Outcome(HostClock(), 0.0, jacks.stop)
    try:
        jacks.move_to(36.0)
    except MoveStoppedError:
        assert rig.truth_mm() < 35.0
    else:  # the stop came before the move began
        assert rig.truth_mm() == pytest.approx(36.0, abs=0.02)
    stop.get()
    jacks.move_to(20.0)


def test_a_stopped_homing_leaves_the_jacks_not_homed():
    with jack_rig("rtu", start_mm=70.0) as rig:
        rig.driver.connect()
        stop = on_the_way(rig, rig.driver.stop)
        with pytest.raises(MoveStoppedError, match="homing: stopped on the way"):
            rig.driver.home()
        stop.get()
        assert not rig.driver.status().homed
        assert 1.0 < rig.truth_mm() < 69.0
        rig.driver.home()
        assert rig.truth_mm() == pytest.approx(0.0, abs=0.02)


def test_one_jack_that_can_not_be_commanded_stops_the_other(rig):
    """The upper drive refuses its command when the lower jack has set off."""
    jacks = rig.ready()
    upper = rig.emulator.drives[1]
    take = upper.write

    def refuse(address, words):
        if address == 0x0058:
            raise RefusedError(4)
        take(address, words)

    upper.write = refuse
    with pytest.raises(DeviceFaultError, match=r"moving to 60 mm \(upper jack\): it could not do it"):
        jacks.move_to(60.0)
    time.sleep(0.3)
    assert not jacks.status().moving
    assert rig.truth_mm() < 20.0
    upper.write = take
    jacks.move_to(6.0)
