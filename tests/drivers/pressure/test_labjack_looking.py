"""Who closes vents what they have set, and nothing that another program on the same T7 holds."""

import struct
import threading

import pytest
from pyModbusTCP.client import ModbusClient

from drivers.clock import VirtualClock
from drivers.emulators.modbus.labjack_t7 import Wiring
from drivers.emulators.wire import WireFault
from drivers.errors import DeviceError, DeviceFaultError, OutOfLimitsError, UnsupportedError
from drivers.pressure.labjack_t7 import LabJackT7Pressure
from drivers.registry import DriverContext
from tests.drivers.pressure.rigs import pressure_rig
from tests.drivers.pressure.test_labjack_faults import wait_for
from tests.drivers.pressure.test_labjack_watchdog import options, rig_with

DAC0, ENABLE = 1000, 61600


class Other:
    """Another program with the other connection: DAC0 and the watchdog as the T7 has them."""

    def __init__(self, address):
        host, port = address.removeprefix("tcp://").split(":")
        self._client = ModbusClient(host=host, port=int(port), unit_id=1, timeout=5.0)

    def set_volts(self, volts):
        assert self._client.write_multiple_registers(DAC0, list(struct.unpack(">HH", struct.pack(">f", volts))))

    def volts(self):
        return struct.unpack(">f", struct.pack(">HH", *self._words(DAC0)))[0]

    def watchdog(self):
        return self._words(ENABLE)[1]

    def close(self):
        self._client.close()

    def _words(self, address):
        words = self._client.read_holding_registers(address, 2)
        assert words is not None
        return words


@pytest.fixture
def rig():
    with pressure_rig(answer_timeout_s=0.5) as rig:
        yield rig


@pytest.fixture
def other(rig):
    other = Other(rig.emulator.address)
    yield other
    other.close()


def test_a_look_leaves_the_pressure_and_the_watchdog_of_another_program():
    with rig_with(clock=VirtualClock()) as rig:
        holding = rig.driver
        holding.connect()
        holding.set_pressure(8.0)
        wait_for(lambda: rig.truth_kpa() > 7.9)
        written = rig.emulator.watchdog_writes
        looking = LabJackT7Pressure(options(rig.emulator.address), DriverContext("looking"))
        for _ in range(2):
            looking.connect()
            assert looking.read().pressure_kpa == pytest.approx(rig.truth_kpa(), abs=0.05)
            assert looking.set_point_kpa() == pytest.approx(8.0)
            looking.close()
        assert holding.set_point_kpa() == pytest.approx(8.0)
        assert rig.simulated.set_point_kpa() == pytest.approx(8.0)
        assert rig.truth_kpa() > 7.9
        assert rig.emulator.watchdog_writes == written
        rig.emulator.stop()  # and it still guards the pressure
        rig.clock.sleep(10.1)
        wait_for(lambda: rig.truth_kpa() < 0.05)


@pytest.mark.parametrize("pressure_kpa", [0.0, 3.0])
def test_closing_vents_what_this_program_has_set(rig, other, pressure_kpa):
    rig.driver.connect()
    rig.driver.set_pressure(pressure_kpa)
    other.set_volts(2.5)
    rig.driver.close()
    assert (other.volts(), other.watchdog()) == (0.0, 0)


def test_closing_vents_once_and_the_next_look_leaves_it(rig, other):
    rig.driver.connect()
    rig.driver.set_pressure(3.0)
    rig.driver.close()
    other.set_volts(2.5)
    rig.driver.connect()
    rig.driver.close()
    assert other.volts() == 2.5


def test_closing_vents_when_nobody_knows_whether_the_pressure_was_set():
    """The answer is lost, and the watchdog is off: nothing else would vent."""
    with pressure_rig(watchdog_s=0) as rig:
        other = Other(rig.emulator.address)
        rig.driver.connect()
        rig.emulator.faults.inject(WireFault.SILENCE)
        with pytest.raises(DeviceError):
            rig.driver.set_pressure(3.0)
        rig.emulator.faults.clear()
        other.set_volts(2.5)
        wait_for(lambda: reads(rig.driver))
        rig.driver.close()
        assert other.volts() == 0.0
        other.close()


def reads(source):
    try:
        return source.read()
    except DeviceError:
        return None


def test_closing_vents_when_only_the_watchdog_was_armed(rig, other):
    """A pressure that waits for its turn has armed it already."""
    rig.driver.connect()
    other.set_volts(2.5)
    with rig.driver._setting:
        setting = threading.Thread(target=lambda: rig.driver.set_pressure(3.0))
        setting.start()
        wait_for(lambda: other.watchdog() == 1)
        rig.driver._vent_or_log()
        assert (other.volts(), other.watchdog()) == (0.0, 0)
    setting.join()


def test_a_vent_that_failed_is_made_up_for_by_the_next_close(rig, other, caplog):
    rig.driver.connect()
    rig.driver.set_pressure(3.0)
    rig.emulator.faults.inject(WireFault.SILENCE)
    rig.driver.close()
    assert "closed without venting" in caplog.text
    rig.emulator.faults.clear()
    rig.driver.connect()
    rig.driver.close()
    wait_for(lambda: (other.volts(), other.watchdog()) == (0.0, 0))


def test_closing_vents_after_a_trip_also_of_another_s_pressure():
    """Above the ceiling it vents whoever has set it, and again when it closes."""
    with pressure_rig(wiring=Wiring(regulator_kpa_per_v=6.4), top_kpa=25.0, ceiling_kpa=16.5, watchdog_s=0) as rig:
        other = Other(rig.emulator.address)
        rig.driver.connect()
        other.set_volts(2.8)
        wait_for(lambda: other.volts() == 0.0)
        with pytest.raises(DeviceFaultError, match="above the ceiling"):
            rig.driver.set_pressure(1.0)
        other.set_volts(0.5)
        rig.driver.close()
        assert other.volts() == 0.0
        other.close()


def test_a_pressure_that_was_refused_is_not_one_that_was_set(rig, other):
    rig.driver.connect()
    other.set_volts(2.5)
    with pytest.raises(OutOfLimitsError):
        rig.driver.set_pressure(100.0)
    rig.driver.close()
    assert other.volts() == 2.5
    with rig_with(firmware=1.0012) as old:
        other_of_old = Other(old.emulator.address)
        old.driver.connect()
        other_of_old.set_volts(2.5)
        with pytest.raises(UnsupportedError):
            old.driver.set_pressure(3.0)
        old.driver.close()
        assert other_of_old.volts() == 2.5
        other_of_old.close()
