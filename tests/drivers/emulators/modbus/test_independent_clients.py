"""Clients of other authors read and command the emulators: minimalmodbus on the serial line, pyModbusTCP on TCP."""

import struct
import time

import minimalmodbus
import pytest
from pyModbusTCP.client import ModbusClient

from drivers.clock import HostClock
from drivers.emulators.modbus import LabJackT7Emulator
from drivers.registry import DriverContext
from drivers.simulated import SimulatedPressure, SimulatedPressureOptions
from tests.drivers.jacks.rigs import jack_rig
from tests.drivers.simulated.tiny_world import TinyWorld

PATIENCE_S = 5.0


def wait_for(happened):
    deadline_s = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < deadline_s, "it did not happen"
        time.sleep(0.01)


@pytest.fixture
def line():
    """The jacks on a serial line, and the two drives as minimalmodbus sees them."""
    with jack_rig("rtu") as rig:
        drives = []
        for unit in (1, 2):
            drive = minimalmodbus.Instrument(rig.emulator.address, unit, close_port_after_each_call=True)
            drive.serial.timeout = 0.5
            drives.append(drive)
        yield rig, drives


def driver_output(drive):
    return drive.read_register(0x007F)


def feedback_position(drive):
    return drive.read_long(0x00CC, signed=True, byteorder=minimalmodbus.BYTEORDER_BIG)


def direct_data(position, *, kind=1, speed=3000, trigger=1):
    return list(struct.unpack(">16H", struct.pack(">8i", 0, kind, position, speed, 30000, 30000, 1000, trigger)))


def home(drives):
    for drive in drives:
        drive.write_register(0x007D, 1 << 4, functioncode=16)
    for drive in drives:
        wait_for(lambda drive=drive: driver_output(drive) & (1 << 4 | 1 << 13) == 1 << 4)
        drive.write_register(0x007D, 0, functioncode=6)


def test_the_drives_home_move_and_stop_by_minimalmodbus(line):
    rig, drives = line
    lower, upper = drives
    assert [driver_output(drive) & 1 << 4 for drive in drives] == [0, 0]
    home(drives)
    assert [feedback_position(drive) for drive in drives] == [0, 0]
    lower.write_registers(0x0058, direct_data(1234))
    wait_for(lambda: driver_output(lower) & 1 << 13)
    wait_for(lambda: driver_output(lower) & 1 << 14)
    assert feedback_position(lower) == 1234
    assert lower.read_long(0x00C6, signed=True) == 1234
    assert feedback_position(upper) == 0
    assert rig.truth_mm() == pytest.approx(12.34, abs=1e-9)
    upper.write_registers(0x0058, direct_data(4200))
    wait_for(lambda: feedback_position(upper) > 300)
    upper.write_register(0x007D, 1 << 5, functioncode=16)
    wait_for(lambda: not driver_output(upper) & 1 << 13)
    stopped_at = feedback_position(upper)
    assert 300 < stopped_at < 4100
    upper.write_registers(0x0058, direct_data(4200))  # STOP is still on
    assert not driver_output(upper) & (1 << 13 | 1 << 5)
    assert feedback_position(upper) == stopped_at


@pytest.mark.parametrize(
    ("words", "alarm"),
    [
        (direct_data(4201), 0x67),
        (direct_data(-1), 0x67),
        (direct_data(100, kind=2), 0x70),
        (direct_data(100, speed=0), 0x70),
    ],
)
def test_the_drives_refuse_and_tell_why(line, words, alarm):
    _, drives = line
    home(drives)
    drives[0].write_registers(0x0058, words)
    assert driver_output(drives[0]) & 1 << 7
    assert drives[0].read_long(0x0080) == alarm
    drives[0].write_registers(0x0058, direct_data(100))
    assert not driver_output(drives[0]) & 1 << 13
    drives[0].write_register(0x007D, 1 << 7, functioncode=16)
    assert drives[0].read_long(0x0080) == 0
    drives[0].write_registers(0x0058, direct_data(100))
    wait_for(lambda: feedback_position(drives[0]) == 100)


def test_a_drive_that_was_not_homed_does_not_move_absolutely(line):
    _, (lower, _) = line
    lower.write_registers(0x0058, direct_data(100))
    assert lower.read_long(0x0080) == 0x4A


def test_the_line_answers_only_for_its_units_and_addresses(line):
    rig, (lower, _) = line
    with pytest.raises(minimalmodbus.IllegalRequestError, match="data address"):
        lower.read_register(0x0500)
    with pytest.raises(minimalmodbus.IllegalRequestError, match="function"):
        lower.read_bit(0x0000)
    nobody = minimalmodbus.Instrument(rig.emulator.address, 3, close_port_after_each_call=True)
    nobody.serial.timeout = 0.1
    with pytest.raises(minimalmodbus.NoResponseError):
        nobody.read_register(0x007F)
    # function 8 with data that comes back: Modbus Application Protocol 1.1b3, section 6.8
    assert lower._perform_command(8, b"\x00\x00\xa5\x37") == b"\x00\x00\xa5\x37"


def test_the_drives_behind_tcp_by_pymodbustcp():
    with jack_rig("tcp") as rig:
        host, port = rig.emulator.address.removeprefix("tcp://").split(":")
        client = ModbusClient(host=host, port=int(port), unit_id=2, timeout=1.0)
        try:
            assert client.write_single_register(0x007D, 1 << 4)
            wait_for(lambda: (client.read_holding_registers(0x007F) or [0])[0] & (1 << 4 | 1 << 13) == 1 << 4)
            assert client.write_multiple_registers(0x007D, [0])
            assert client.write_multiple_registers(0x0058, direct_data(256))
            wait_for(lambda: client.read_holding_registers(0x00CC, 2) == [0, 256])
        finally:
            client.close()


@pytest.fixture
def labjack():
    """The LabJack, its pressure, and pyModbusTCP connected to it."""
    clock = HostClock()
    options = SimulatedPressureOptions(noise_kpa=0.0, lag_s=0.03, vent_lag_s=0.03)
    source = SimulatedPressure(options, DriverContext("pressure", clock, TinyWorld(clock)))
    emulator = LabJackT7Emulator(source)
    emulator.start()
    host, port = emulator.address.removeprefix("tcp://").split(":")
    client = ModbusClient(host=host, port=int(port), unit_id=1, timeout=1.0)
    yield emulator, source, client
    client.close()
    emulator.stop()


def value(client, address, kind):
    words = client.read_holding_registers(address, 2)
    return struct.unpack(f">{kind}", struct.pack(">HH", *words))[0]


def words_of(volts):
    return list(struct.unpack(">HH", struct.pack(">f", volts)))


def test_the_labjack_by_pymodbustcp(labjack):
    emulator, source, client = labjack
    assert value(client, 55100, "I") == 0x00112233
    assert value(client, 60000, "f") == 7.0
    assert value(client, 60028, "I") == 470012345
    assert value(client, 0, "f") == pytest.approx(0.5)
    assert client.write_multiple_registers(1000, words_of(2.5))
    assert value(client, 1000, "f") == 2.5
    # 2.5 V x 3.2 kPa/V; 0.5 V + 0.2 V/kPa
    wait_for(lambda: source.true_pressure_kpa() > 7.999)
    assert value(client, 0, "f") == pytest.approx(0.5 + 0.2 * 8.0, abs=0.001)
    emulator.power_cycle()
    client.close()
    assert value(client, 1000, "f") == 0.0
    wait_for(lambda: source.true_pressure_kpa() < 0.01)


def test_the_labjack_s_timer_counts_40_mhz(labjack):
    _, _, client = labjack
    first, began_s = value(client, 61520, "I"), time.monotonic()
    time.sleep(0.2)
    second, ended_s = value(client, 61520, "I"), time.monotonic()
    assert (second - first) % 2**32 == pytest.approx((ended_s - began_s) * 40e6, rel=0.2)


@pytest.mark.parametrize(("address", "words"), [(1000, words_of(5.1)), (1000, words_of(-0.1)), (40000, words_of(3.0))])
def test_the_labjack_refuses_values_it_can_not_have(labjack, address, words):
    _, _, client = labjack
    assert not client.write_multiple_registers(address, words)
    assert client.last_except == 3


@pytest.mark.parametrize(("address", "count"), [(2, 2), (1, 1), (60001, 2)])
def test_the_labjack_refuses_addresses_that_it_does_not_have(labjack, address, count):
    _, _, client = labjack
    assert client.read_holding_registers(address, count) is None
    assert client.last_except == 2


def test_an_address_that_is_taken_is_an_error(labjack):
    emulator, source, _ = labjack
    second = LabJackT7Emulator(source, port=int(emulator.address.rpartition(":")[2]))
    with pytest.raises(OSError, match="in use"):
        second.start()
    second.stop()
    emulator.start()
    assert emulator.summary
