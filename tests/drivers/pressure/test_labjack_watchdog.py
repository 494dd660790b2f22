"""A host that falls silent while the membrane is under pressure: the T7 vents by itself; nothing else makes it.

The emulated T7's clock is turned by hand, except where a process dies.
"""

import struct
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass

import pytest
from pyModbusTCP.client import ModbusClient

from drivers.clock import Clock, HostClock, VirtualClock
from drivers.emulators.modbus import LabJackT7Emulator
from drivers.errors import DeviceError, NotConnectedError, UnsupportedError
from drivers.pressure.labjack_t7 import LabJackT7Options, LabJackT7Pressure
from drivers.registry import DriverContext
from drivers.simulated import SimulatedPressure, SimulatedPressureOptions
from tests.drivers.pressure.rigs import LAG_S, REGULATOR, settings
from tests.drivers.simulated.tiny_world import TinyWorld

PATIENCE_S = 20.0
ENABLE, TIMEOUT_S, RESET_ENABLE, DIO_ENABLE = 61600, 61604, 61620, 61630
LIVES_UNTIL_KILLED = """
import sys, time
from drivers.pressure.labjack_t7 import LabJackT7Options, LabJackT7Pressure
from drivers.registry import DriverContext

source = LabJackT7Pressure(LabJackT7Options.model_validate_json(sys.argv[1]), DriverContext("pressure"))
source.connect()
source.set_pressure(8.0)
print("set", flush=True)
time.sleep(600)
"""


@dataclass
class Rig:
    driver: LabJackT7Pressure
    emulator: LabJackT7Emulator
    simulated: SimulatedPressure
    clock: Clock

    def truth_kpa(self):
        return self.simulated.true_pressure_kpa()

    def registers(self, *addresses, **written):
        """Write, then read, with another program's client."""
        host, port = self.emulator.address.removeprefix("tcp://").split(":")
        client = ModbusClient(host=host, port=int(port), unit_id=1, timeout=2.0)
        try:
            for address, words in written.items():
                assert client.write_multiple_registers(int(address.removeprefix("at_")), words)
            return [client.read_holding_registers(address, 2)[1] for address in addresses]
        finally:
            client.close()


def options(address, **changes):
    wanted = settings(address, **{"regulator": REGULATOR, "answer_timeout_s": 3.0, **changes})
    return LabJackT7Options.model_validate(wanted)


@contextmanager
def rig_with(clock=None, firmware=1.0312, **changes):
    host_clock = HostClock()
    simulated = SimulatedPressure(
        SimulatedPressureOptions(lag_s=LAG_S, vent_lag_s=LAG_S),
        DriverContext("simulated pressure", host_clock, TinyWorld(host_clock)),
    )
    clock = clock or VirtualClock()
    emulator = LabJackT7Emulator(simulated, clock=clock, firmware=firmware)
    emulator.start()
    driver = LabJackT7Pressure(options(emulator.address, **changes), DriverContext("pressure", host_clock))
    try:
        yield Rig(driver, emulator, simulated, clock)
    finally:
        driver.close()
        emulator.stop()


@pytest.fixture
def rig():
    with rig_with() as rig:
        rig.driver.connect()
        yield rig


def wait_for(happened):
    deadline_s = time.monotonic() + PATIENCE_S
    while not (value := happened()):
        assert time.monotonic() < deadline_s, "it did not happen"
        time.sleep(0.01)
    return value


def pressurise(rig, pressure_kpa=8.0):
    rig.driver.set_pressure(pressure_kpa)
    wait_for(lambda: rig.truth_kpa() > 0.95 * pressure_kpa)


def test_a_driver_s_process_that_is_killed_leaves_the_membrane_vented():
    """In real time, with the shortest time that may be asked for."""
    with rig_with(clock=HostClock()) as rig:
        wanted = options(rig.emulator.address, watchdog_s=2, answer_timeout_s=0.9).model_dump_json()
        process = subprocess.Popen([sys.executable, "-c", LIVES_UNTIL_KILLED, wanted], stdout=subprocess.PIPE)
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"set\n"
            wait_for(lambda: rig.truth_kpa() > 7.5)
        finally:
            process.kill()
            process.communicate(timeout=PATIENCE_S)
        assert rig.simulated.set_point_kpa() == 8.0
        wait_for(lambda: rig.truth_kpa() < 0.05)
        assert rig.simulated.set_point_kpa() == 0.0
        assert rig.registers(ENABLE) == [1]


def test_a_cable_that_is_pulled_leaves_the_membrane_vented(rig):
    pressurise(rig)
    rig.emulator.stop()
    rig.clock.sleep(9.9)
    assert rig.simulated.set_point_kpa() == 8.0
    rig.clock.sleep(0.2)
    wait_for(lambda: rig.truth_kpa() < 0.05)
    # and is told as it is when the cable is back, and can go on
    rig.emulator.start()
    assert rig.driver.set_point_kpa() == 0.0
    written = rig.emulator.watchdog_writes
    pressurise(rig)
    rig.emulator.stop()
    rig.clock.sleep(10.1)
    wait_for(lambda: rig.truth_kpa() < 0.05)
    assert rig.emulator.watchdog_writes == written


def test_the_sampling_alone_keeps_it_away(rig):
    pressurise(rig)
    for _ in range(5):
        rig.clock.sleep(9.9)
        last_ns = round(HostClock().now_s() * 1e9)
        wait_for(lambda since_ns=last_ns: rig.driver.readings_since(since_ns).readings)
        assert rig.simulated.set_point_kpa() == 8.0


def test_it_is_as_long_as_asked_for():
    with rig_with(watchdog_s=60) as rig:
        rig.driver.connect()
        pressurise(rig)
        rig.emulator.stop()
        rig.clock.sleep(59.9)
        assert rig.simulated.set_point_kpa() == 8.0
        rig.clock.sleep(0.2)
        assert rig.simulated.set_point_kpa() == 0.0


def test_pressures_and_vents_do_not_write_the_flash_again_and_again(rig):
    rig.driver.vent()
    rig.driver.set_pressure(0.0)
    assert rig.emulator.watchdog_writes == 0
    rig.driver.set_pressure(1.0)
    armed = rig.emulator.watchdog_writes
    # time-out, DAC0's enable, and the watchdog's: the rest is as it left the factory
    assert armed == 3
    for pressure_kpa in (2.0, 0.0, 3.0):
        rig.driver.set_pressure(pressure_kpa)
        rig.driver.vent()
    rig.emulator.stop()
    rig.emulator.start()
    wait_for(lambda: is_back(rig.driver))
    rig.driver.set_pressure(4.0)
    assert rig.emulator.watchdog_writes == armed
    rig.driver.close()
    rig.driver.connect()
    rig.driver.set_pressure(1.0)
    assert rig.emulator.watchdog_writes == armed + 2


def is_back(source):
    try:
        return source.read()
    except DeviceError:
        return None


def test_closing_disarms_it_once_vented(rig):
    pressurise(rig)
    assert rig.registers(ENABLE) == [1]
    rig.driver.close()
    assert rig.registers(ENABLE, TIMEOUT_S) == [0, 10]
    rig.registers(at_1000=list(struct.unpack(">HH", struct.pack(">f", 2.5))))
    rig.clock.sleep(1000.0)
    assert rig.simulated.set_point_kpa() == 8.0


def test_closing_without_pressure_touches_nothing(rig):
    rig.registers(at_61604=[0, 33], at_61600=[0, 1])
    written = rig.emulator.watchdog_writes
    rig.driver.vent()
    rig.driver.close()
    assert rig.registers(ENABLE, TIMEOUT_S) == [1, 33]
    assert rig.emulator.watchdog_writes == written


def test_a_vent_that_could_not_be_sent_leaves_it_armed(rig, caplog):
    pressurise(rig)
    written = rig.emulator.watchdog_writes
    rig.emulator.stop()
    rig.driver.close()
    assert "closed without venting" in caplog.text
    assert "the T7 vents 10 s after" in caplog.text
    rig.clock.sleep(10.1)
    wait_for(lambda: rig.truth_kpa() < 0.05)
    assert rig.emulator.watchdog_writes == written
    # whoever comes next finds it armed, uses it as it is, and disarms it
    rig.emulator.start()
    rig.driver.connect()
    pressurise(rig)
    assert rig.emulator.watchdog_writes == written
    rig.driver.close()
    assert rig.registers(ENABLE) == [0]


def test_another_s_settings_are_replaced_and_their_other_actions_kept(rig):
    """A reset would break the connections, strict mode would vent in spite of the sampling."""
    rig.registers(at_61604=[0, 33], at_61610=[0, 1], at_61620=[0, 1], at_61630=[0, 1], at_61642=[0x4000, 0])
    rig.registers(at_61640=[0, 1], at_61600=[0, 1])
    pressurise(rig)
    assert rig.registers(ENABLE, TIMEOUT_S, 61610, RESET_ENABLE, DIO_ENABLE, 61640, 61642) == [1, 10, 0, 0, 1, 1, 0]
    rig.emulator.stop()
    rig.clock.sleep(10.1)
    wait_for(lambda: rig.truth_kpa() < 0.05)


def test_none_was_asked_for():
    with rig_with(watchdog_s=0, firmware=1.0012) as rig:
        rig.driver.connect()
        pressurise(rig)
        rig.emulator.stop()
        rig.clock.sleep(1000.0)
        assert rig.simulated.set_point_kpa() == 8.0
        rig.emulator.start()
    assert rig.emulator.watchdog_writes == 0


def test_a_firmware_without_it_sets_no_pressure_and_says_what_to_do():
    with rig_with(firmware=1.0012) as rig:
        rig.driver.connect()
        for _ in range(2):
            words = (
                r"pressure: setting 8 kPa: its firmware 1\.0012 refuses .*watchdog; .*set watchdog_s = 0 to do without"
            )
            with pytest.raises(UnsupportedError, match=words):
                rig.driver.set_pressure(8.0)
        assert rig.driver.set_point_kpa() == 0.0
        rig.driver.vent()


def test_pressing_and_closing_at_once_never_leaves_it_under_pressure_and_unarmed(rig):
    """Whichever comes first: vented and disarmed, or under pressure and armed, so that silence vents."""
    for _ in range(10):
        rig.driver.connect()
        began = threading.Barrier(2)

        def press(began=began):
            began.wait(PATIENCE_S)
            try:
                rig.driver.set_pressure(8.0)
            except NotConnectedError:
                return

        pressing = threading.Thread(target=press)
        pressing.start()
        began.wait(PATIENCE_S)
        rig.driver.close()
        pressing.join(PATIENCE_S)
        assert not pressing.is_alive()
        (enabled,) = rig.registers(ENABLE)
        assert enabled == 1 or rig.simulated.set_point_kpa() == 0.0
        rig.clock.sleep(10.1)
        assert rig.simulated.set_point_kpa() == 0.0


def in_a_thread(call):
    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    return thread


def test_a_pressure_that_comes_while_it_closes_is_armed_again(rig):
    """Armed, then disarmed by `close` while it waits, and the connection still there."""
    with rig.driver._setting:
        pressing = in_a_thread(lambda: rig.driver.set_pressure(8.0))
        wait_for(lambda: rig.registers(ENABLE) == [1])
        rig.driver._vent_or_log()
        assert rig.registers(ENABLE) == [0]
    pressing.join(PATIENCE_S)
    assert not pressing.is_alive()
    assert rig.simulated.set_point_kpa() == 8.0
    assert rig.registers(ENABLE) == [1]


def test_a_vent_does_not_wait_for_it(rig):
    pressurise(rig)
    with rig.driver._watchdog._lock:
        pressing = in_a_thread(lambda: rig.driver.set_pressure(9.0))
        venting = in_a_thread(rig.driver.vent)
        venting.join(PATIENCE_S)
        assert not venting.is_alive()
        assert pressing.is_alive()
        assert rig.simulated.set_point_kpa() == 0.0
    pressing.join(PATIENCE_S)
    assert not pressing.is_alive()


def test_a_new_connection_looks_whether_it_is_still_armed(rig):
    pressurise(rig)
    rig.registers(at_61600=[0, 0])
    rig.emulator.stop()
    rig.emulator.start()
    wait_for(lambda: is_back(rig.driver))
    rig.driver.set_pressure(9.0)
    assert rig.registers(ENABLE) == [1]
