"""Faults that are typed: which devices they strike, when they end, and what a line that is none is told."""

import pytest

from drivers.clock import VirtualClock
from drivers.emulators.orders import EmulatedDevice, FaultOrders, OrderError
from drivers.emulators.wire import WireFault, WireFaults

STRUCK = {"silence": b"", "garbled": b"ansber", "partial": b"ans"}
"""What comes of "answer"; the middle byte is another."""


class Bench:
    def __init__(self):
        self.clock = VirtualClock()
        self.faults = {name: (WireFaults(late_s=0.0), WireFaults(late_s=0.0)) for name in ("rotation", "primary")}
        self.cycled, self.shares = [], []
        self.orders = FaultOrders(
            {
                "rotation": EmulatedDevice(self.faults["rotation"], lambda: self.cycled.append("rotation")),
                "primary": EmulatedDevice(
                    self.faults["primary"], lambda: self.cycled.append("primary"), self.shares.append
                ),
            },
            self.clock,
        )

    def heard(self, device="rotation"):
        return [faults.outgoing(b"answer") for faults in self.faults[device]]


@pytest.fixture
def bench():
    return Bench()


@pytest.mark.parametrize("fault", STRUCK)
def test_a_fault_strikes_all_lines_of_one_device_for_its_time(bench, fault):
    assert bench.orders.carry_out(f"fault rotation {fault} 3\n") == f"rotation: {fault} for 3 s"
    assert bench.heard() == [STRUCK[fault]] * 2
    assert bench.heard("primary") == [b"answer"] * 2
    bench.clock.sleep(2.9)
    assert bench.heard() == [STRUCK[fault]] * 2
    bench.clock.sleep(0.2)
    assert bench.heard() == [b"answer"] * 2


def test_the_later_of_two_equal_orders_tells_the_end(bench):
    bench.orders.carry_out("fault rotation silence 3")
    bench.clock.sleep(2.0)
    bench.orders.carry_out("fault rotation silence 3")
    bench.clock.sleep(2.0)
    assert bench.heard() == [b"", b""]
    bench.orders.carry_out("fault rotation silence 0.5")
    bench.clock.sleep(0.6)
    assert bench.heard() == [b"answer"] * 2


def test_two_faults_at_once_end_by_themselves(bench):
    bench.orders.carry_out("fault rotation partial 1")
    bench.orders.carry_out("fault rotation silence 3")
    bench.clock.sleep(2.0)
    assert bench.heard() == [b"", b""]
    bench.clock.sleep(2.0)
    assert bench.heard() == [b"answer"] * 2


def test_packets_are_lost_and_come_again(bench):
    assert bench.orders.carry_out("fault primary lost-packets 2.5") == "primary: lost-packets for 2.5 s"
    assert bench.shares == [0.1]
    bench.clock.sleep(2.6)
    assert bench.shares == [0.1, 0.0]


def test_a_power_cycle(bench):
    assert bench.orders.carry_out("fault rotation power-cycle") == "rotation: switched off and on"
    assert bench.cycled == ["rotation"]


def test_all_faults_end_with_the_orders(bench):
    bench.orders.carry_out("fault rotation silence 3")
    bench.orders.carry_out("fault primary lost-packets 3")
    bench.orders.close()
    assert bench.heard() == [b"answer"] * 2
    assert bench.shares == [0.1, 0.0]
    bench.clock.sleep(4.0)
    assert bench.shares == [0.1, 0.0]


def test_help_lists_every_device_and_every_fault(bench):
    lines = bench.orders.carry_out("help").splitlines()
    assert "  rotation: silence, late, garbled, partial, power-cycle" in lines
    assert "  primary: silence, late, garbled, partial, lost-packets, power-cycle" in lines
    explained = {line.partition(":")[0] for line in lines[3:]}
    assert explained == {*WireFault, "lost-packets", "power-cycle"}
    assert bench.orders.carry_out("  ") == ""


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("falt rotation silence 3", "'falt' is no order; type help, or a fault as in: fault rotation silence 3"),
        ("fault", "a fault wants a device, its name and seconds, as in: fault rotation silence 3"),
        ("fault rotation silence", "a fault wants a device, its name and seconds"),
        ("fault rotation silence 3 4", "a fault wants a device, its name and seconds"),
        ("fault rotaton silence 3", "there is no device 'rotaton'; name one of rotation, primary"),
        ("fault rotation lost-packets 3", "rotation can not have 'lost-packets'; it can have silence, late"),
        ("fault rotation silent 3", "rotation can not have 'silent'; it can have silence, late"),
        ("fault rotation power-cycle 3", "power-cycle takes no seconds"),
        ("fault rotaton power-cycle", "there is no device 'rotaton'"),
        *(
            (f"fault rotation silence {wrong}", f"{wrong!r} is no duration")
            for wrong in ("soon", "0", "-1", "nan", "inf")
        ),
    ],
)
def test_a_line_that_is_no_order_is_told_in_a_sentence(bench, line, words):
    with pytest.raises(OrderError) as raised:
        bench.orders.carry_out(line)
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)
    assert bench.heard() == [b"answer"] * 2
    assert bench.cycled == []


def test_a_late_answer_does_not_wait_longer_than_the_fault():
    faults = WireFaults(late_s=60.0)
    faults.inject(WireFault.LATE)
    faults.clear(WireFault.SILENCE)
    faults.clear(WireFault.LATE)
    assert faults.outgoing(b"answer") == b"answer"
