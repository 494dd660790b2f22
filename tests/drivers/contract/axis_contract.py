"""What every axis must do. A driver's test class inherits `AxisContract` and overrides the fixtures."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from drivers.clock import Clock, VirtualClock
from drivers.errors import (
    DeviceBusyError,
    DeviceError,
    MoveStoppedError,
    NotConnectedError,
    NotHomedError,
    OutOfLimitsError,
)
from drivers.interfaces import Axis
from tests.drivers.contract.outcome import Outcome, all_at_once


class AxisContract:
    """Override `axis`; also `clock` and `places` where the driver is not simulated."""

    @pytest.fixture
    def clock(self) -> Clock:
        return VirtualClock()

    @pytest.fixture
    def axis(self, clock: Clock) -> Axis:
        """A driver that is not connected yet."""
        raise NotImplementedError

    @pytest.fixture
    def places(self) -> tuple[float, float, float]:
        """Three positions in the axis's unit, a second or more of travel apart, each allowed."""
        raise NotImplementedError

    @pytest.fixture
    def ready(self, axis: Axis) -> Iterator[Axis]:
        """The axis connected, and homed if it can be."""
        axis.connect()
        if not axis.status().homed:
            axis.home()
        yield axis
        axis.close()

    def test_is_an_axis(self, axis: Axis):
        assert isinstance(axis, Axis)
        assert axis.name

    def test_connects_and_closes_twice(self, axis: Axis):
        axis.close()
        axis.connect()
        axis.connect()
        assert axis.status().connected
        axis.close()
        axis.close()
        assert not axis.status().connected
        axis.connect()
        assert axis.status().connected
        axis.close()

    def test_connects_and_closes_from_many_threads(self, axis: Axis):
        all_at_once(axis.connect)
        assert axis.status().connected
        all_at_once(axis.close)
        assert not axis.status().connected

    def test_connecting_moves_nothing(self, axis: Axis):
        axis.connect()
        before = axis.status()
        axis.close()
        axis.connect()
        assert not before.moving
        assert repr(axis.status()) == repr(before)  # a NaN equals itself so
        axis.close()

    def test_needs_a_connection(self, axis: Axis, places):
        calls = (axis.info, axis.home, lambda: axis.move_to(places[0]), lambda: axis.move_duration_s(places[0]))
        for call in calls:
            with pytest.raises(NotConnectedError, match=axis.name):
                call()
        status = axis.status()
        assert (status.connected, status.homed, status.moving) == (False, False, False)
        assert math.isnan(status.position)
        axis.stop()

    def test_tells_what_it_can_do(self, ready: Axis, places):
        info = ready.info()
        assert info.unit in ("mm", "deg")
        assert info.limits.low < info.limits.high
        assert 0.0 < info.resolution < info.limits.high - info.limits.low
        assert info.repeatability >= 0.0
        assert info.speed > 0.0
        assert info.vendor and info.model and info.serial
        assert all(info.limits.contains(place) for place in places)

    def test_refuses_to_move_before_homing(self, axis: Axis, places):
        axis.connect()
        before = axis.status()
        if before.homed:
            pytest.skip("this axis always knows where it is")
        with pytest.raises(NotHomedError):
            axis.move_to(places[0])
        assert repr(axis.status()) == repr(before)
        axis.close()

    def test_homes(self, ready: Axis):
        if not ready.info().can_home:
            pytest.skip("this axis has no reference switch")
        ready.home()
        status = ready.status()
        assert status.homed and not status.moving and not status.fault
        assert ready.info().limits.contains(status.position)
        assert status.target == status.position

    def test_arrives(self, ready: Axis, places):
        half_step = ready.info().resolution / 2.0
        for place in (*places, *reversed(places), places[0] + ready.info().resolution * 0.4):
            ready.move_to(place)
            status = ready.status()
            assert status.position == pytest.approx(place, abs=half_step * (1.0 + 1e-6))
            assert status.target == place
            assert not status.moving and not status.fault

    @pytest.mark.parametrize("beyond", ["low", "high", "nan", "infinite"])
    def test_refuses_what_lies_outside_its_limits(self, ready: Axis, beyond):
        info = ready.info()
        position = {
            "low": info.limits.low - info.resolution,
            "high": info.limits.high + info.resolution,
            "nan": math.nan,
            "infinite": math.inf,
        }[beyond]
        before = ready.status()
        with pytest.raises(OutOfLimitsError, match=ready.name):
            ready.move_to(position)
        with pytest.raises(OutOfLimitsError, match=ready.name):
            ready.move_duration_s(position)
        assert ready.status() == before

    def test_knows_how_long_a_move_takes(self, ready: Axis, places):
        ready.move_to(places[0])
        before = ready.status()
        durations_s = [ready.move_duration_s(place) for place in sorted(places, key=lambda p: abs(p - places[0]))]
        assert durations_s[0] == 0.0
        assert durations_s == sorted(set(durations_s))
        assert ready.status() == before

    def test_is_seen_moving(self, ready: Axis, clock: Clock, places):
        ready.move_to(places[0])
        half_s = ready.move_duration_s(places[1]) / 2.0
        outcome = Outcome(clock, half_s, ready.status)
        ready.move_to(places[1])
        status = outcome.get()
        assert status.moving
        assert status.target == places[1]
        assert min(places[:2]) < status.position < max(places[:2])

    def test_refuses_a_second_move(self, ready: Axis, clock: Clock, places):
        ready.move_to(places[0])
        half_s = ready.move_duration_s(places[1]) / 2.0
        move, home = (Outcome(clock, half_s, call) for call in (lambda: ready.move_to(places[2]), ready.home))
        ready.move_to(places[1])
        with pytest.raises(DeviceBusyError, match=ready.name):
            move.get()
        if ready.info().can_home:
            with pytest.raises(DeviceBusyError, match=ready.name):
                home.get()
        assert ready.status().position == pytest.approx(places[1], abs=ready.info().resolution)

    def test_stops_on_the_way_and_goes_on(self, ready: Axis, clock: Clock, places):
        ready.move_to(places[0])
        outcome = Outcome(clock, ready.move_duration_s(places[1]) / 2.0, ready.stop)
        with pytest.raises(MoveStoppedError, match=ready.name):
            ready.move_to(places[1])
        outcome.get()
        status = ready.status()
        assert status.homed and not status.moving and not status.fault
        assert min(places[:2]) < status.position < max(places[:2])
        ready.move_to(places[1])
        assert ready.status().position == pytest.approx(places[1], abs=ready.info().resolution)

    def test_stopping_at_rest_does_nothing(self, ready: Axis, places):
        ready.move_to(places[0])
        before = ready.status()
        ready.stop()
        ready.stop()
        assert ready.status() == before
        ready.move_to(places[1])

    def test_closing_stops_it(self, ready: Axis, clock: Clock, places):
        ready.move_to(places[0])
        outcome = Outcome(clock, ready.move_duration_s(places[1]) / 2.0, ready.close)
        with pytest.raises(DeviceError) as raised:
            ready.move_to(places[1])
        outcome.get()
        assert isinstance(raised.value, MoveStoppedError | NotConnectedError)
        assert not ready.status().connected
        ready.connect()
        assert not ready.status().moving
        assert min(places[:2]) < ready.status().position < max(places[:2])
