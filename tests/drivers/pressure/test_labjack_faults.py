"""Whatever goes wrong between a driver and the LabJack ends in a named error in time, and is over when it ends.

What the sources with and without a regulator share is shown for both. Meanwhile no pressure is told that is not true,
no pressure goes above the ceiling, and samples that are missing count.
"""

import math
import time

import pytest

from drivers.clock import HostClock
from drivers.emulators.modbus.labjack_t7 import Wiring
from drivers.emulators.wire import WireFault
from drivers.errors import (
    DeviceBusyError,
    DeviceError,
    DeviceFaultError,
    DeviceTimeoutError,
    NotConnectedError,
    OutOfLimitsError,
    ProtocolError,
    UnsupportedError,
)
from drivers.pressure.labjack_t7 import LabJackT7Options, LabJackT7Pressure
from drivers.pressure.manual import ManualPressure, ManualPressureOptions
from drivers.registry import DriverContext
from tests.drivers.contract.outcome import all_at_once
from tests.drivers.pressure.rigs import ANSWER_TIMEOUT_S, LAG_S, REGULATOR, pressure_rig, settings

LATE_S = 0.3
SPARE_S = 0.6
PATIENCE_S = 5.0
ON_THE_WIRE = [
    (WireFault.SILENCE, DeviceTimeoutError, "no answer within 0.2 s"),
    (WireFault.LATE, DeviceTimeoutError, "no answer within 0.2 s"),
    (WireFault.GARBLED, (ProtocolError, DeviceTimeoutError), "garbled or cut short|no answer"),
    (WireFault.PARTIAL, (ProtocolError, DeviceTimeoutError), "garbled or cut short|no answer"),
]
CALLS = {
    "read": lambda source: source.read(),
    "set_point_kpa": lambda source: source.set_point_kpa(),
    "set_pressure": lambda source: source.set_pressure(2.0),
    "vent": lambda source: source.vent(),
}
ASKING = {"labjack_t7": tuple(CALLS), "manual": ("read",)}
"""The calls that ask the LabJack: the operator, not the LabJack, is asked for a pressure and told to vent."""


@pytest.fixture
def kind():
    return "labjack_t7"


@pytest.fixture
def rig(kind):
    with pressure_rig(kind) as rig:
        rig.emulator.faults.late_s = LATE_S
        rig.driver.connect()
        yield rig


either_kind = pytest.mark.parametrize("kind", ASKING)


def bring_to(rig, pressure_kpa):
    """Set a pressure, or have the operator turn the regulator."""
    if rig.driver.info().can_set:
        rig.driver.set_pressure(pressure_kpa)
    else:
        rig.simulated.set_pressure(pressure_kpa)


def told_set_point_kpa(rig, pressure_kpa):
    """What the source is to tell of it: one without a regulator was asked for nothing."""
    return pytest.approx(pressure_kpa if rig.driver.info().can_set else 0.0, abs=1e-5)


def wait_for(happened):
    deadline_s = time.monotonic() + PATIENCE_S
    while not (value := happened()):
        assert time.monotonic() < deadline_s, "it did not happen"
        time.sleep(0.01)
    return value


@either_kind
@pytest.mark.parametrize(("fault", "error", "words"), ON_THE_WIRE)
def test_a_fault_of_the_wire(rig, kind, fault, error, words):
    for call in ASKING[kind]:
        rig.emulator.faults.inject(fault)
        began_s = time.monotonic()
        with pytest.raises(error, match=f"pressure: .*({words})"):
            CALLS[call](rig.driver)
        # behind a sample that waits, twice for a vent, and an answer in pieces takes twice its time
        assert time.monotonic() - began_s < 3 * 2 * ANSWER_TIMEOUT_S + SPARE_S
        rig.emulator.faults.clear()
        wait_for(lambda call=call: answers(rig.driver, call))
    rig.driver.vent()
    assert rig.driver.set_point_kpa() == 0.0


def answers(source, call):
    try:
        CALLS[call](source)
    except DeviceError:
        return False
    return True


@either_kind
@pytest.mark.parametrize(("fault", "error", "words"), ON_THE_WIRE)
def test_connecting_through_a_fault(kind, fault, error, words):
    with pressure_rig(kind) as rig:
        rig.emulator.faults.late_s = LATE_S
        rig.emulator.faults.inject(fault)
        with pytest.raises(NotConnectedError, match=f"connecting: .*({words})"):
            rig.driver.connect()
        rig.emulator.faults.clear()
        rig.driver.connect()
        assert rig.driver.read().pressure_kpa == pytest.approx(0.0, abs=0.05)


@either_kind
@pytest.mark.parametrize("fault", WireFault)
def test_no_pressure_is_told_that_is_not_true(rig, fault):
    told = 0
    for pressure_kpa, count in ((4.0, 1), (12.0, 2)):
        bring_to(rig, pressure_kpa)
        time.sleep(12 * LAG_S)
        settled_ns = round(HostClock().now_s() * 1e9)
        rig.emulator.faults.inject(fault, count=count)
        for _ in range(5):
            try:
                assert rig.driver.read().pressure_kpa == pytest.approx(pressure_kpa, abs=0.05)
                assert rig.driver.set_point_kpa() == told_set_point_kpa(rig, pressure_kpa)
                told += 1
            except DeviceError:
                continue
        samples = rig.driver.readings_since(settled_ns).readings
        assert all(sample.pressure_kpa == pytest.approx(pressure_kpa, abs=0.05) for sample in samples)
        rig.emulator.faults.clear()
        wait_for(lambda: answers(rig.driver, "read"))
    assert told >= 2


@either_kind
def test_unplugged_and_plugged_in_again(rig, kind):
    bring_to(rig, 4.0)
    time.sleep(8 * LAG_S)
    rig.emulator.stop()
    for call in ASKING[kind]:
        began_s = time.monotonic()
        with pytest.raises(NotConnectedError, match="pressure: "):
            CALLS[call](rig.driver)
        assert time.monotonic() - began_s < ANSWER_TIMEOUT_S + SPARE_S
    rig.emulator.start()
    assert rig.driver.read().pressure_kpa == pytest.approx(4.0, abs=0.1)
    assert rig.driver.set_point_kpa() == told_set_point_kpa(rig, 4.0)


@either_kind
def test_a_power_cycle_is_told_as_it_is(kind):
    """DAC0 falls to 0 V, so the set-point is 0, and the input's settings are made again."""
    with pressure_rig(kind, settling_us=250.0) as rig:
        rig.driver.connect()
        bring_to(rig, 4.0)
        rig.emulator.power_cycle()
        assert wait_for(lambda: answers(rig.driver, "read"))
        assert rig.driver.set_point_kpa() == 0.0
        time.sleep(8 * LAG_S)
        assert rig.driver.read().pressure_kpa == pytest.approx(0.0, abs=0.05)
        assert rig.emulator._registers.read(42000, 2) == [0x437A, 0]  # 250 as a float
        bring_to(rig, 2.0)
        time.sleep(8 * LAG_S)
        assert rig.driver.read().pressure_kpa == pytest.approx(2.0, abs=0.05)


def test_other_programs_hold_both_connections_of_a_source_turned_by_hand():
    with pressure_rig("manual") as rig:
        options = ManualPressureOptions.model_validate(settings(rig.emulator.address))
        first, second = (ManualPressure(options, DriverContext(name, HostClock())) for name in ("first", "second"))
        first.connect()
        second.connect()
        with pytest.raises(DeviceBusyError, match=r"pressure: .*end the other program"):
            rig.driver.connect()
        with pytest.raises(NotConnectedError):
            rig.driver.read()
        first.close()
        wait_for(lambda: connects(rig.driver))
        assert rig.driver.read().pressure_kpa == pytest.approx(0.0, abs=0.05)
        second.close()


def connects(source):
    try:
        source.connect()
    except DeviceBusyError:
        return False
    return True


def test_other_programs_hold_both_connections(rig):
    options = LabJackT7Options.model_validate(settings(rig.emulator.address, regulator=REGULATOR))
    second, third = (LabJackT7Pressure(options, DriverContext(name, HostClock())) for name in ("second", "third"))
    second.connect()
    with pytest.raises(DeviceBusyError, match=r"third: .*end the other program"):
        third.connect()
    with pytest.raises(NotConnectedError):
        third.read()
    # what another program sets is told, not what was asked for here
    second.set_pressure(3.0)
    assert rig.driver.set_point_kpa() == pytest.approx(3.0, abs=1e-5)
    second.close()
    third.connect()
    third.close()


@either_kind
def test_samples_steadily_on_the_clock_of_the_frames(rig):
    clock = HostClock()
    began_ns = round(clock.now_s() * 1e9)
    time.sleep(1.0)
    ended_ns = round(clock.now_s() * 1e9)
    fetched = rig.driver.readings_since(began_ns)
    times_ns = [reading.host_time_ns for reading in fetched.readings]
    assert times_ns == sorted(set(times_ns))
    assert began_ns < times_ns[0]
    assert times_ns[-1] <= round(clock.now_s() * 1e9)
    # 100 a second, each either there or counted
    assert len(times_ns) + fetched.lost == pytest.approx(
        (ended_ns - began_ns) * 1e-9 * rig.driver.sample_rate_hz, abs=4
    )
    assert len(times_ns) >= 50
    assert rig.driver.readings_since(times_ns[-1]).readings[:1] != fetched.readings[-1:]


@either_kind
def test_samples_that_could_not_be_taken_are_counted(rig):
    wait_for(lambda: rig.driver.readings_since(0).readings)
    last_ns = rig.driver.readings_since(0).readings[-1].host_time_ns
    rig.emulator.faults.inject(WireFault.SILENCE, count=1)
    fetched = wait_for(lambda: later(rig.driver, last_ns, 0.9))
    span_s = (fetched.readings[-1].host_time_ns - last_ns) * 1e-9
    assert fetched.lost >= 15  # the time-out of 0.2 s
    assert len(fetched.readings) + fetched.lost == pytest.approx(span_s * rig.driver.sample_rate_hz, abs=3)


def later(source, last_ns, span_s):
    fetched = source.readings_since(last_ns)
    enough = fetched.readings and fetched.readings[-1].host_time_ns - last_ns > span_s * 1e9
    return fetched if enough else None


@either_kind
def test_a_reading_is_timed_by_its_exchange_not_by_its_wait(rig):
    """A sample that waits for the line is not timed in the middle of the wait."""
    wait_for(lambda: rig.driver.readings_since(0).readings)
    clock = HostClock()
    with rig.driver._transducer.labjack.line.alone(1, "holding the line"):
        held_from_ns = round(clock.now_s() * 1e9)
        time.sleep(0.2)
        held_to_ns = round(clock.now_s() * 1e9)
    wait_for(lambda: rig.driver.readings_since(held_to_ns).readings)
    assert not [
        reading
        for reading in rig.driver.readings_since(held_from_ns).readings
        if held_from_ns < reading.host_time_ns < held_to_ns
    ]


@either_kind
def test_sampling_ends_with_the_connection(rig):
    wait_for(lambda: rig.driver.readings_since(0).readings)
    rig.driver.close()
    with pytest.raises(NotConnectedError):
        rig.driver.readings_since(0)
    rig.driver.connect()
    wait_for(lambda: rig.driver.readings_since(0).readings)


def test_a_pressure_above_the_ceiling_vents_and_keeps_the_regulator_off():
    """A regulator with twice the configured gain: 9 kPa asked for would be 18 kPa."""
    wiring = Wiring(regulator_kpa_per_v=6.4)
    with pressure_rig(wiring=wiring, top_kpa=25.0, ceiling_kpa=16.5) as rig:
        rig.driver.connect()
        rig.driver.set_pressure(9.0)
        wait_for(lambda: rig.driver.set_point_kpa() == 0.0)
        assert rig.truth_kpa() < 18.0
        with pytest.raises(DeviceFaultError, match=r"vented at 1[67]\.\d+ kPa, above the ceiling of 16\.5 kPa"):
            rig.driver.set_pressure(1.0)
        time.sleep(8 * LAG_S)
        assert rig.truth_kpa() == pytest.approx(0.0, abs=0.05)
        rig.driver.vent()
        rig.driver.set_pressure(1.0)
        assert rig.driver.set_point_kpa() == pytest.approx(1.0, abs=1e-5)


def test_a_broken_transducer_is_no_pressure_and_vents():
    """0 V of a transducer that gives 0.5 V at 0 kPa would be -2.5 kPa."""
    with pressure_rig(wiring=Wiring(transducer_v_at_0_kpa=0.0, transducer_v_per_kpa=0.0)) as rig:
        rig.driver.connect()
        with pytest.raises(DeviceFaultError, match=r"0 V would be -2\.5 kPa, outside the transducer's range"):
            rig.driver.read()
        wait_for(lambda: refused(rig.driver))
        assert rig.driver.set_point_kpa() == 0.0
        assert rig.driver.readings_since(0).readings == ()


def test_a_broken_transducer_of_a_source_turned_by_hand_is_no_pressure():
    with pressure_rig("manual", wiring=Wiring(transducer_v_at_0_kpa=0.0, transducer_v_per_kpa=0.0)) as rig:
        rig.driver.connect()
        with pytest.raises(DeviceFaultError, match=r"0 V would be -2\.5 kPa, outside the transducer's range"):
            rig.driver.read()
        assert rig.driver.readings_since(0).readings == ()


def refused(source):
    try:
        source.set_pressure(1.0)
    except DeviceFaultError as error:
        return "can not be right" in str(error)
    return False


def test_pressures_outside_the_limits_send_not_a_byte(rig):
    sent = rig.driver._transducer.labjack.line._trace  # the line's own ear
    outgoing = []

    def listen(sending, data):
        if sending and data[8:10] == b"\x03\xe8":
            outgoing.append(data)
        return sent(sending, data)

    rig.driver._transducer.labjack.line._client.transaction.trace_packet = listen
    for wrong_kpa in (-0.001, 16.001, 1e9, math.nan, math.inf):
        with pytest.raises(OutOfLimitsError, match="choose a pressure from 0 to 16 kPa"):
            rig.driver.set_pressure(wrong_kpa)
    assert outgoing == []
    rig.driver.set_pressure(16.0)
    assert [data[7] for data in outgoing] == [0x10, 0x03]


def test_the_last_of_many_commands_is_a_vent(rig):
    def command():
        for _ in range(5):
            rig.driver.set_pressure(5.0)
            rig.driver.vent()

    all_at_once(command, threads=4)
    assert rig.driver.set_point_kpa() == 0.0


def test_closing_without_an_answer_ends_in_time(rig, caplog):
    rig.driver.set_pressure(2.0)
    rig.emulator.faults.inject(WireFault.SILENCE)
    began_s = time.monotonic()
    rig.driver.close()
    assert time.monotonic() - began_s < 4 * ANSWER_TIMEOUT_S + SPARE_S
    assert "closed without venting" in caplog.text


def test_a_source_turned_by_hand_tells_the_operator():
    with pressure_rig("manual", limits_kpa=[0.0, 10.0]) as rig:
        rig.driver.connect()
        assert not rig.driver.info().can_set
        with pytest.raises(UnsupportedError, match="turned by hand; ask the operator"):
            rig.driver.set_pressure(5.0)
        rig.simulated.set_pressure(12.0)
        (told,) = wait_for(lambda: rig.operator.told)
        assert "above the limit of 10 kPa: turn back" in told
        rig.driver.vent()
        assert "vent: turn the regulator back" in rig.operator.told[1]
        rig.simulated.vent()
        time.sleep(8 * LAG_S)
        assert len(rig.operator.told) == 2
