"""Zaber's own library, zaber-motion, talks to the emulator in native units, beside and after the driver."""

import pytest
from zaber_motion import Units
from zaber_motion.ascii import Connection, WarningFlags
from zaber_motion.exceptions import CommandFailedException, MovementFailedException, MovementInterruptedException

from drivers.clock import HostClock
from drivers.emulators.zaber import ZaberEmulator
from drivers.errors import DeviceBusyError, DeviceFaultError, UnsupportedError
from drivers.simulated import Fault
from tests.drivers.contract.outcome import Outcome
from tests.drivers.stages.rigs import MICROSTEPS_PER_UNIT, serving, simulated, zaber_axis

PER_MM = MICROSTEPS_PER_UNIT["mm"]
on_both_lines = pytest.mark.parametrize("emulator", ["pty", "tcp"], indirect=True)


@pytest.fixture
def stages():
    return [(simulated(unit, MICROSTEPS_PER_UNIT[unit]), MICROSTEPS_PER_UNIT[unit]) for unit in ("mm", "deg")]


@pytest.fixture
def emulator(request, stages):
    with serving(ZaberEmulator(stages, transport=getattr(request, "param", "tcp"))) as emulator:
        yield emulator


def open_vendor(emulator) -> Connection:
    if emulator.address.startswith("tcp:"):
        host, _, port = emulator.address.removeprefix("tcp://").partition(":")
        return Connection.open_tcp(host, int(port))
    return Connection.open_serial_port(emulator.address)


@on_both_lines
def test_homes_moves_and_reads_two_devices(emulator, stages):
    with open_vendor(emulator) as connection:
        assert [device.device_address for device in connection.detect_devices(identify_devices=False)] == [1, 2]
        for address, (stage, scale) in enumerate(stages, start=1):
            axis = connection.get_device(address).get_axis(1)
            assert not axis.is_homed()
            assert axis.warnings.get_flags() == {WarningFlags.NO_REFERENCE_POSITION}
            axis.home()
            assert axis.is_homed()
            assert axis.get_position(Units.NATIVE) == 0
            axis.move_absolute(12345, Units.NATIVE)
            assert axis.get_position(Units.NATIVE) == 12345
            assert stage.true_position() == pytest.approx(12345 / scale, abs=1e-6)
            axis.move_relative(-345, Units.NATIVE)
            assert axis.get_position(Units.NATIVE) == 12000
            assert axis.warnings.get_flags() == set()


def test_refuses_what_it_can_not_do(emulator):
    with open_vendor(emulator) as connection:
        axis = connection.get_device(1).get_axis(1)
        axis.home()
        with pytest.raises(CommandFailedException, match="BADDATA"):
            axis.move_absolute(101 * PER_MM, Units.NATIVE)
        with pytest.raises(CommandFailedException, match="BADCOMMAND"):
            axis.generic_command("get nothing.at.all")


def test_stops_and_stalls(emulator, stages):
    with open_vendor(emulator) as connection:
        axis = connection.get_device(1).get_axis(1)
        axis.home()
        outcome = Outcome(HostClock(), 0.2, lambda: connection.get_device(1).generic_command("stop"))
        with pytest.raises(MovementInterruptedException):
            axis.move_absolute(round(20 * PER_MM), Units.NATIVE)
        outcome.get()
        axis.wait_until_idle()
        assert 0 < axis.get_position(Units.NATIVE) < 20 * PER_MM
        stages[0][0].faults.inject(Fault.STALLED_MOVE, count=1)
        with pytest.raises(MovementFailedException) as raised:
            axis.move_absolute(round(20 * PER_MM), Units.NATIVE)
        assert raised.value.details.warnings == [WarningFlags.STALLED_AND_STOPPED]
        assert axis.warnings.get_flags() == set()


def test_reads_what_the_driver_has_set(emulator):
    axis = zaber_axis("mm", emulator.address, speed=20.0, acceleration=100.0)
    axis.connect()
    axis.home()
    axis.move_to(2.0)
    axis.close()
    with open_vendor(emulator) as connection:
        device = connection.get_device(1)
        seen = device.get_axis(1)
        assert seen.get_position(Units.NATIVE) == round(2.0 * PER_MM)
        assert seen.is_homed()
        # 20 mm/s and 100 mm/s^2 in Zaber's units
        assert seen.settings.get("maxspeed") == round(20.0 * PER_MM * 1.6384)
        assert seen.settings.get("accel") == round(100.0 * PER_MM * 1.6384 / 10000)
        assert device.generic_command("get comm.checksum").data == "1"


@on_both_lines
def test_the_driver_goes_on_where_the_maker_left_off(emulator):
    with open_vendor(emulator) as connection:
        axis = connection.get_device(1).get_axis(1)
        axis.home()
        axis.move_absolute(12345, Units.NATIVE)
    axis = zaber_axis("mm", emulator.address)
    axis.connect()
    assert axis.status().homed
    assert axis.status().position == pytest.approx(12345 / PER_MM, abs=1e-9)
    axis.close()


@on_both_lines
def test_two_axes_share_a_line(emulator, stages):
    axes = [zaber_axis(unit, emulator.address, address=place) for place, unit in enumerate(("mm", "deg"), start=1)]
    for axis in axes:
        axis.connect()
    for axis, (stage, _) in zip(axes, stages, strict=True):
        axis.home()
        axis.move_to(3.0)
        assert stage.true_position() == pytest.approx(3.0, abs=1e-3)
    assert axes[0].info().serial != axes[1].info().serial
    axes[0].close()
    axes[1].move_to(2.0)
    axes[0].connect()
    assert axes[0].status().position == pytest.approx(3.0, abs=1e-4)
    for axis in axes:
        axis.close()


@on_both_lines
def test_another_program_has_the_line(emulator):
    axis = zaber_axis("mm", emulator.address)
    with open_vendor(emulator) as connection:
        connection.get_device(1).generic_command("get pos")
        if emulator.address.startswith("tcp:"):
            with pytest.raises(DeviceBusyError, match="another program"):
                axis.connect()
    axis.connect()
    axis.close()


def test_limits_beyond_the_devices_own_are_refused(emulator):
    axis = zaber_axis("mm", emulator.address, limits=(0.0, 100.1))
    with pytest.raises(UnsupportedError, match="travels from 0 to 100 mm only"):
        axis.connect()
    assert not axis.status().connected


def test_a_stall_is_told_in_words(emulator, stages):
    axis = zaber_axis("mm", emulator.address)
    axis.connect()
    axis.home()
    stages[0][0].faults.inject(Fault.STALLED_MOVE, count=1)
    with pytest.raises(DeviceFaultError, match="motor stalled"):
        axis.move_to(10.0)
    assert axis.status().fault == "motor stalled"
    axis.move_to(1.0)
    assert axis.status().fault == ""
    axis.close()
