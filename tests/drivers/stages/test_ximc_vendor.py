"""Standa's own library, libximc, opens the emulator, and reads what the driver did."""

import libximc.highlevel as ximc
import pytest

from drivers.emulators.ximc import XimcEmulator
from drivers.errors import DeviceBusyError, DeviceFaultError
from drivers.simulated import Fault
from tests.drivers.stages.rigs import serving, simulated, ximc_axis

HOMED, ALARM = ximc.StateFlags.STATE_IS_HOMED, ximc.StateFlags.STATE_ALARM


@pytest.fixture
def stage():
    return simulated("mm", 400.0 * 256)


@pytest.fixture(params=["pty", "tcp"])
def emulator(request, stage):
    with serving(XimcEmulator(stage, "mm", transport=request.param)) as emulator:
        yield emulator


@pytest.fixture
def vendor(emulator):
    scheme = "xi-" if emulator.address.startswith("tcp:") else "xi-com://"
    return ximc.Axis(scheme + emulator.address)


def position(vendor: ximc.Axis) -> tuple[int, int]:
    place = vendor.get_position()
    return place.Position, place.uPosition


def test_homes_moves_and_reads(stage, vendor):
    vendor.open_device()
    assert HOMED not in vendor.get_status().Flags
    vendor.command_homezero()
    assert position(vendor) == (0, 0)
    assert HOMED in vendor.get_status().Flags
    assert stage.true_position() == 0.0
    motion = vendor.get_move_settings()
    motion.Speed = 16000
    vendor.set_move_settings(motion)
    assert vendor.get_move_settings().Speed == 16000
    vendor.command_move(800, 17)
    vendor.command_wait_for_stop(10)
    assert position(vendor) == (800, 17)
    assert stage.true_position() == pytest.approx(2.0 + 17 / 256 / 400.0, abs=1e-8)
    vendor.command_movr(-400, -34)
    vendor.command_wait_for_stop(10)
    assert position(vendor) == (399, 239)
    vendor.close_device()


def test_tells_who_it_is(vendor):
    vendor.open_device()
    information = vendor.get_device_information()
    assert (information.Manufacturer, information.ProductDescription) == ("XIMC", "8SMC5")
    assert vendor.get_serial_number() > 0
    assert vendor.get_firmware_version() == (4, 6, 6)
    assert vendor.get_entype_settings().EngineType == ximc.EngineType.ENGINE_TYPE_STEP
    vendor.close_device()


def test_a_soft_stop_keeps_the_reference_and_a_hard_one_does_not(vendor):
    vendor.open_device()
    vendor.command_homezero()
    for stop, homed in ((vendor.command_sstp, True), (vendor.command_stop, False)):
        vendor.command_move(4000, 0)
        stop()
        vendor.command_wait_for_stop(10)
        assert (HOMED in vendor.get_status().Flags) == homed
        assert position(vendor)[0] < 4000
    vendor.close_device()


def test_an_alarm_stays_until_it_is_stopped(stage, vendor):
    vendor.open_device()
    stage.faults.inject(Fault.STALLED_MOVE, count=1)
    vendor.command_move(4000, 0)
    vendor.command_wait_for_stop(10)
    status = vendor.get_status()
    assert ALARM in status.Flags
    assert status.MvCmdSts & ximc.MvcmdStatus.MVCMD_ERROR
    here = position(vendor)
    vendor.command_move(0, 0)
    vendor.command_wait_for_stop(10)
    assert position(vendor) == here
    vendor.command_stop()
    assert ALARM not in vendor.get_status().Flags
    vendor.close_device()


def test_reads_what_the_driver_has_set(emulator, vendor):
    homing = {"direction": "right", "stop_at": "sync", "fast_speed": 100.0, "slow_speed": 2.5, "position": 1.0}
    axis = ximc_axis("mm", emulator.address, homing=homing, backlash=0.05, microsteps=32)
    axis.connect()
    axis.home()
    axis.move_to(2.0 + 5 / 32 / 400.0)
    axis.close()
    vendor.open_device()
    assert position(vendor) == (800, 5)
    assert HOMED in vendor.get_status().Flags
    motion, engine, home = vendor.get_move_settings(), vendor.get_engine_settings(), vendor.get_home_settings()
    assert (motion.Speed, motion.uSpeed, motion.Accel, motion.Decel) == (4000, 0, 64000, 64000)
    assert motion.AntiplaySpeed == 2000
    assert engine.MicrostepMode == ximc.MicrostepMode.MICROSTEP_MODE_FRAC_32
    assert engine.Antiplay == 20
    assert ximc.EngineFlags.ENGINE_ANTIPLAY in engine.EngineFlags
    assert (home.FastHome, home.SlowHome) == (40000, 1000)
    assert ximc.HomeFlags.HOME_DIR_FIRST in home.HomeFlags
    assert home.HomeFlags & ximc.HomeFlags.HOME_STOP_FIRST_BITS == ximc.HomeFlags.HOME_STOP_FIRST_SYN
    assert ximc.HomeFlags.HOME_MV_SEC_EN not in home.HomeFlags
    vendor.close_device()


def test_the_driver_goes_on_where_the_maker_left_off(emulator, vendor):
    vendor.open_device()
    vendor.command_homezero()
    vendor.command_move(400, 64)
    vendor.command_wait_for_stop(10)
    vendor.close_device()
    axis = ximc_axis("mm", emulator.address)
    axis.connect()
    assert axis.status().homed
    assert axis.status().position == pytest.approx(1.0 + 0.25 / 400.0, abs=1e-9)
    axis.close()


def test_they_keep_each_other_out(emulator, vendor):
    axis = ximc_axis("mm", emulator.address)
    vendor.open_device()
    vendor.get_status()
    with pytest.raises(DeviceBusyError, match="another program"):
        axis.connect()
    assert not axis.status().connected
    vendor.close_device()
    axis.connect()
    assert axis.status().connected
    if not emulator.address.startswith("tcp:"):
        with pytest.raises(ConnectionError):
            vendor.open_device()
    axis.close()


def test_an_alarm_is_told_in_words(emulator, stage):
    axis = ximc_axis("mm", emulator.address)
    axis.connect()
    axis.home()
    stage.faults.inject(Fault.STALLED_MOVE, count=1)
    with pytest.raises(DeviceFaultError, match="slipped or stalled"):
        axis.move_to(10.0)
    assert "slipped or stalled" in axis.status().fault
    axis.home()
    assert axis.status().fault == ""
    axis.move_to(1.0)
    axis.close()
