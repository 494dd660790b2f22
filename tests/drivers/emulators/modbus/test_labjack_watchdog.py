"""The emulated T7's watchdog does what LabJack's Modbus map and datasheet (T-Series, section 23) say, by pyModbusTCP.

Its clock is turned by hand, so its times are exact.
"""

import struct
import time

import pytest
from pyModbusTCP.client import ModbusClient

from drivers.clock import HostClock, VirtualClock
from drivers.emulators.modbus import LabJackT7Emulator
from drivers.registry import DriverContext
from drivers.simulated import SimulatedPressure, SimulatedPressureOptions
from tests.drivers.simulated.tiny_world import TinyWorld

ENABLE, ADVANCED, TIMEOUT_S, STARTUP_DELAY_S = 61600, 61602, 61604, 61606
STRICT_ENABLE, STRICT_KEY, STRICT_CLEAR = 61610, 61612, 61614
DAC0_ENABLE, DAC0_SAFE, DAC0 = 61640, 61642, 1000
PATIENCE_S = 5.0


class T7:
    """The emulated T7, what hangs on it, and a client."""

    def __init__(self, **changes):
        clock = HostClock()
        options = SimulatedPressureOptions(noise_kpa=0.0, lag_s=0.03, vent_lag_s=0.03)
        self.source = SimulatedPressure(options, DriverContext("pressure", clock, TinyWorld(clock)))
        self.clock = VirtualClock()
        self.emulator = LabJackT7Emulator(self.source, clock=self.clock, **changes)
        self.emulator.start()
        host, port = self.emulator.address.removeprefix("tcp://").split(":")
        self.client = ModbusClient(host=host, port=int(port), unit_id=1, timeout=2.0)

    def write(self, address, value, kind="I"):
        words = list(struct.unpack(">HH", struct.pack(f">{kind}", value)))
        return self.client.write_multiple_registers(address, words)

    def read(self, address, kind="I"):
        return struct.unpack(f">{kind}", struct.pack(">HH", *self.client.read_holding_registers(address, 2)))[0]

    def arm(self, timeout_s=10, **settings):
        assert self.write(ENABLE, 0)
        assert self.write(TIMEOUT_S, timeout_s)
        assert self.write(DAC0_ENABLE, 1)
        assert self.write(DAC0_SAFE, 0.0, "f")
        for name, value in settings.items():
            assert self.write(globals()[name], value)
        assert self.write(ENABLE, 1)

    def pressurise(self):
        assert self.write(DAC0, 2.5, "f")
        self.wait_for(lambda kpa: kpa > 7.9)

    def wait_for(self, wanted):
        deadline_s = time.monotonic() + PATIENCE_S
        while not wanted(self.source.true_pressure_kpa()):
            assert time.monotonic() < deadline_s, f"stays at {self.source.true_pressure_kpa()} kPa"
            time.sleep(0.01)


@pytest.fixture
def t7():
    t7 = T7()
    yield t7
    t7.client.close()
    t7.emulator.stop()


def test_it_sets_dac0_after_its_time_of_silence_and_no_sooner(t7):
    t7.arm(10)
    t7.pressurise()
    t7.clock.sleep(9.99)
    assert t7.source.set_point_kpa() == 8.0
    t7.clock.sleep(0.02)
    t7.wait_for(lambda kpa: kpa < 0.01)
    assert t7.read(DAC0, "f") == 0.0


def test_any_answer_keeps_it_away_a_refusal_too(t7):
    t7.arm(10)
    t7.pressurise()
    for ask in (lambda: t7.read(DAC0), lambda: t7.client.read_holding_registers(2, 2), lambda: t7.write(7, 1)) * 2:
        t7.clock.sleep(9.0)
        ask()
    assert t7.read(DAC0, "f") == 2.5


def test_silence_counts_on_while_the_cable_is_pulled(t7):
    t7.arm(10)
    t7.pressurise()
    t7.emulator.stop()
    t7.clock.sleep(10.01)
    t7.wait_for(lambda kpa: kpa < 0.01)


def test_it_acts_again_after_the_next_answer(t7):
    t7.arm(10)
    for _ in range(2):
        t7.pressurise()
        t7.clock.sleep(10.01)
        t7.wait_for(lambda kpa: kpa < 0.01)


@pytest.mark.parametrize("changed", [ENABLE, DAC0_ENABLE])
def test_disabled_it_does_nothing(t7, changed):
    t7.arm(10)
    assert t7.write(ENABLE, 0)
    assert t7.write(changed, 0)
    t7.write(ENABLE, int(changed != ENABLE))
    t7.pressurise()
    t7.clock.sleep(1000.0)
    assert t7.read(DAC0, "f") == 2.5


def test_its_settings_are_taken_only_while_disabled(t7):
    t7.arm(10)
    assert not t7.write(TIMEOUT_S, 20)
    assert t7.client.last_except == 4
    assert t7.read(TIMEOUT_S) == 10
    assert t7.write(ENABLE, 0)
    assert t7.write(TIMEOUT_S, 20)
    assert t7.read(TIMEOUT_S) == 20


def test_each_setting_wears_the_flash_and_stays_without_power(t7):
    assert t7.emulator.watchdog_writes == 0
    t7.arm(10, STARTUP_DELAY_S=30)
    t7.write(STRICT_CLEAR, 0)
    assert t7.read(ENABLE) == 1
    assert t7.emulator.watchdog_writes == 6
    t7.emulator.power_cycle()
    t7.client.close()
    assert t7.emulator.watchdog_writes == 6
    assert [t7.read(address) for address in (ENABLE, TIMEOUT_S, DAC0_ENABLE)] == [1, 10, 1]
    t7.pressurise()
    t7.clock.sleep(10.01)
    assert t7.read(DAC0, "f") == 0.0


def test_strict_only_the_key_keeps_it_away(t7):
    t7.arm(10, STRICT_ENABLE=1, STRICT_KEY=0x1234)
    t7.pressurise()
    t7.clock.sleep(9.0)
    assert t7.write(STRICT_CLEAR, 0x1234)
    t7.clock.sleep(9.0)
    assert t7.read(DAC0, "f") == 2.5
    t7.write(STRICT_CLEAR, 0x4321)
    t7.clock.sleep(1.01)
    assert t7.read(DAC0, "f") == 0.0


@pytest.mark.parametrize(("address", "value", "kind", "code"), [(DAC0_SAFE, 5.5, "f", 3), (61608, 1, "I", 2)])
def test_it_refuses_what_it_does_not_have(t7, address, value, kind, code):
    assert not t7.write(address, value, kind)
    assert t7.client.last_except == code


def test_an_older_firmware_has_none():
    t7 = T7(firmware=1.0012)
    try:
        assert t7.read(60004, "f") == pytest.approx(1.0012)
        assert t7.client.read_holding_registers(ENABLE, 2) is None
        assert t7.client.last_except == 2
        assert not t7.write(ENABLE, 1)
    finally:
        t7.client.close()
        t7.emulator.stop()
