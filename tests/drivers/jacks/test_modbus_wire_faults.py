"""Whatever happens to an answer on its way from the drives ends in a named error in time, and is over when it ends.

Meanwhile no position is told that is not true: every status either raises, or knows nothing, or is right.
"""

import time

import pytest

from drivers.emulators.wire import WireFault
from drivers.errors import (
    DeviceError,
    DeviceTimeoutError,
    NotConnectedError,
    ProtocolError,
)
from tests.drivers.jacks.rigs import CALLS, FAST_MM_S, SPARE_S, TRANSPORTS, jack_rig, on_the_way, recovers, stands_at

ANSWER_TIMEOUT_S = {"tcp": 0.2, "rtu": 0.5}
"""A pseudo terminal hands bytes on in the kernel's own time."""
LATER_S = 0.1
"""How much later than the driver waits a late answer comes, so it comes while the next question is asked."""
ON_THE_WIRE = [
    (WireFault.SILENCE, DeviceTimeoutError, "no answer within 0.[25] s"),
    (WireFault.LATE, DeviceTimeoutError, "no answer within 0.[25] s"),
    (WireFault.GARBLED, ProtocolError, "garbled or cut short"),
    (WireFault.PARTIAL, ProtocolError, "garbled or cut short"),
]


@pytest.fixture(params=TRANSPORTS)
def transport(request):
    return request.param


@pytest.fixture
def rig(transport):
    timeout_s = ANSWER_TIMEOUT_S[transport]
    with jack_rig(transport, speed_mm_s=FAST_MM_S, answer_timeout_s=timeout_s) as rig:
        rig.emulator.faults.late_s = timeout_s + LATER_S
        yield rig


@pytest.mark.parametrize(("fault", "error", "words"), ON_THE_WIRE)
def test_a_fault_of_the_wire(rig, transport, fault, error, words):
    jacks = rig.ready()
    for call in ("status", "move_to", "stop"):
        rig.emulator.faults.inject(fault)
        began_s = time.monotonic()
        with pytest.raises(error, match=f"jack: .*{words}"):
            CALLS[call](jacks)
        # two drives, and an answer in pieces takes twice its time
        assert time.monotonic() - began_s < 2 * 2 * ANSWER_TIMEOUT_S[transport] + SPARE_S
        rig.emulator.faults.clear()
        recovers(jacks.stop)
        assert recovers(lambda: stands_at(jacks, 0.0))
    recovers(lambda: jacks.move_to(6.0))
    assert rig.truth_mm() == pytest.approx(6.0, abs=0.02)


@pytest.mark.parametrize(("fault", "error", "words"), ON_THE_WIRE)
def test_connecting_through_a_fault(rig, fault, error, words):
    rig.emulator.faults.inject(fault)
    with pytest.raises(NotConnectedError, match=r"lower jack.*upper jack"):
        rig.driver.connect()
    assert not rig.driver.status().connected
    rig.emulator.faults.clear()
    recovers(rig.driver.connect)
    assert recovers(rig.driver.status).connected


@pytest.mark.parametrize("fault", WireFault)
def test_no_position_is_told_that_is_not_true(rig, fault):
    """The jack moves on between any two questions, so an old answer would be a wrong one."""
    jacks = rig.ready()
    lower = rig.simulated.carriages[0]
    rig.emulator.faults.inject(fault, count=2)
    told = 0
    for shift in range(1, 40):
        lower.drive_to(0.5 * shift, FAST_MM_S)
        time.sleep(lower.state().remaining_s + 0.01)
        try:
            status = jacks.status()
        except DeviceError:
            continue
        told += 1
        assert status.position == pytest.approx(0.5 * shift, abs=0.001)
        assert (status.homed, status.moving) == (True, False)
        if told == 3:
            break
    assert told == 3


@pytest.mark.parametrize(
    ("transport", "fault"), [("tcp", WireFault.SILENCE), ("rtu", WireFault.GARBLED)], indirect=["transport"]
)
def test_a_fault_of_the_wire_during_a_move(rig, transport, fault):
    jacks = rig.ready()
    whole_s = jacks.move_duration_s(36.0)
    trouble = on_the_way(rig, lambda: rig.emulator.faults.inject(fault))
    began_s = time.monotonic()
    with pytest.raises((DeviceTimeoutError, ProtocolError), match="moving to 36 mm"):
        jacks.move_to(36.0)
    assert time.monotonic() - began_s < whole_s + 4 * 2 * ANSWER_TIMEOUT_S[transport] + SPARE_S
    trouble.get()
    rig.emulator.faults.clear()
    recovers(jacks.stop)
    time.sleep(0.2)
    assert recovers(lambda: stands_at(jacks, rig.truth_mm()))
    recovers(lambda: jacks.move_to(20.0))
    assert rig.truth_mm() == pytest.approx(20.0, abs=0.02)


@pytest.mark.parametrize("transport", ["tcp"], indirect=True)
def test_one_lost_answer_during_a_move_stops_both_jacks(rig):
    jacks = rig.ready()
    on_the_way(rig, lambda: rig.emulator.faults.inject(WireFault.SILENCE, count=1))
    with pytest.raises(DeviceTimeoutError):
        jacks.move_to(80.0)
    time.sleep(0.2)
    here_mm = rig.truth_mm()
    assert 2.0 < here_mm < 79.0
    assert not jacks.status().moving
    assert stands_at(jacks, here_mm)
