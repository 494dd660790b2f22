"""What every pressure source must do. A driver's test class inherits `PressureContract` and overrides fixtures."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from drivers.clock import Clock, VirtualClock
from drivers.errors import NotConnectedError, OutOfLimitsError, UnsupportedError
from drivers.interfaces import PressureSource
from tests.drivers.contract.outcome import all_at_once


class PressureContract:
    """Override `source`; also `clock`, `settle_s` and `high_kpa` where the driver is not simulated."""

    settle_s = 10.0
    """Time after which the pressure differs from its set-point by less than the noise."""
    high_kpa = 5.0
    """A pressure that the rig stands."""

    @pytest.fixture
    def clock(self) -> Clock:
        return VirtualClock()

    @pytest.fixture
    def source(self, clock: Clock) -> PressureSource:
        """A driver that is not connected yet."""
        raise NotImplementedError

    @pytest.fixture
    def ready(self, source: PressureSource) -> Iterator[PressureSource]:
        """The source connected, at room pressure."""
        source.connect()
        yield source
        source.close()

    def test_is_a_pressure_source(self, source: PressureSource):
        assert isinstance(source, PressureSource)
        assert source.name

    def test_connects_and_closes_twice(self, source: PressureSource):
        source.close()
        source.connect()
        source.connect()
        source.read()
        source.close()
        source.close()
        with pytest.raises(NotConnectedError):
            source.read()
        source.connect()
        source.read()
        source.close()

    def test_connects_and_closes_from_many_threads(self, source: PressureSource):
        all_at_once(source.connect)
        source.read()
        all_at_once(source.close)
        with pytest.raises(NotConnectedError):
            source.read()

    def test_needs_a_connection(self, source: PressureSource):
        for call in (source.info, source.read, source.set_point_kpa, lambda: source.set_pressure(1.0), source.vent):
            with pytest.raises(NotConnectedError, match=source.name):
                call()

    def test_tells_what_it_can_do(self, ready: PressureSource):
        info = ready.info()
        assert info.limits_kpa.low < self.high_kpa < info.limits_kpa.high
        assert info.noise_kpa >= 0.0
        assert info.vendor and info.model and info.serial

    def test_reads_room_pressure_at_first(self, ready: PressureSource, clock: Clock):
        before_ns = round(clock.now_s() * 1e9)
        reading = ready.read()
        assert abs(reading.pressure_kpa) <= 6.0 * ready.info().noise_kpa + 1e-9
        assert before_ns <= reading.host_time_ns <= round(clock.now_s() * 1e9)

    def test_goes_where_it_is_told(self, ready: PressureSource, clock: Clock):
        info = ready.info()
        if not info.can_set:
            with pytest.raises(UnsupportedError):
                ready.set_pressure(self.high_kpa)
            return
        for pressure_kpa in (self.high_kpa, self.high_kpa / 10.0, self.high_kpa / 2.0):
            ready.set_pressure(pressure_kpa)
            assert ready.set_point_kpa() == pytest.approx(pressure_kpa)
            clock.sleep(self.settle_s)
            assert ready.read().pressure_kpa == pytest.approx(pressure_kpa, abs=7.0 * info.noise_kpa + 1e-6)

    @pytest.mark.parametrize("beyond", ["low", "high", "nan"])
    def test_refuses_what_lies_outside_its_limits(self, ready: PressureSource, beyond):
        limits = ready.info().limits_kpa
        before_kpa = ready.set_point_kpa()
        with pytest.raises(OutOfLimitsError, match=ready.name):
            ready.set_pressure({"low": limits.low - 0.1, "high": limits.high + 0.1, "nan": math.nan}[beyond])
        assert ready.set_point_kpa() == before_kpa

    def test_vents(self, ready: PressureSource, clock: Clock):
        if ready.info().can_set:
            ready.set_pressure(self.high_kpa)
            clock.sleep(self.settle_s)
        ready.vent()
        ready.vent()
        assert ready.set_point_kpa() == 0.0
        clock.sleep(self.settle_s)
        assert abs(ready.read().pressure_kpa) <= 7.0 * ready.info().noise_kpa + 1e-6

    def test_closing_vents(self, ready: PressureSource, clock: Clock):
        if ready.info().can_set:
            ready.set_pressure(self.high_kpa)
            clock.sleep(self.settle_s)
        ready.close()
        clock.sleep(self.settle_s)
        ready.connect()
        assert ready.set_point_kpa() == 0.0
        assert abs(ready.read().pressure_kpa) <= 7.0 * ready.info().noise_kpa + 1e-6
