"""The simulated pressure source: the contract, and the lag and the noise against their formulae."""

import math

import numpy as np
import pytest

from drivers.errors import OutOfLimitsError
from drivers.registry import DriverContext
from drivers.simulated import SimulatedPressure, SimulatedPressureOptions
from tests.drivers.contract.pressure_contract import PressureContract


class TestSimulatedPressure(PressureContract):
    @pytest.fixture
    def source(self, clock, world):
        return SimulatedPressure(SimulatedPressureOptions(), DriverContext("pressure", clock, world))


@pytest.fixture
def source(clock, world):
    source = SimulatedPressure(
        SimulatedPressureOptions(lag_s=0.5, vent_lag_s=0.2, noise_kpa=0.01), DriverContext("pressure", clock, world)
    )
    source.connect()
    return source


def test_follows_a_set_point_with_a_first_order_lag(clock, world, source):
    source.set_pressure(10.0)
    assert world.now("pressure_kpa") == 0.0
    for _ in range(4):
        clock.sleep(0.25)
        expected_kpa = 10.0 * (1.0 - math.exp(-clock.now_s() / 0.5))
        assert world.now("pressure_kpa") == pytest.approx(expected_kpa, abs=1e-12)


def test_a_new_set_point_starts_from_where_the_pressure_is(clock, world, source):
    source.set_pressure(10.0)
    clock.sleep(0.5)
    half_way_kpa = 10.0 * (1.0 - math.exp(-1.0))
    source.set_pressure(2.0)
    assert world.now("pressure_kpa") == pytest.approx(half_way_kpa, abs=1e-12)
    clock.sleep(0.5)
    assert world.now("pressure_kpa") == pytest.approx(2.0 + (half_way_kpa - 2.0) * math.exp(-1.0), abs=1e-12)


def test_vents_with_a_lag_of_its_own(clock, world, source):
    source.set_pressure(10.0)
    clock.sleep(50.0)
    source.vent()
    clock.sleep(0.2)
    assert world.now("pressure_kpa") == pytest.approx(10.0 * math.exp(-1.0), abs=1e-9)


def test_readings_are_noisy_and_the_truth_is_not(clock, world, source):
    source.set_pressure(4.0)
    clock.sleep(50.0)
    readings_kpa = np.array([source.read().pressure_kpa for _ in range(1000)])
    assert world.now("pressure_kpa") == 4.0
    assert np.mean(readings_kpa) == pytest.approx(4.0, abs=0.0015)
    assert np.std(readings_kpa) == pytest.approx(0.01, rel=0.1)


def test_limits_are_options(clock, world):
    source = SimulatedPressure(SimulatedPressureOptions(limits_kpa=(0.0, 8.0)), DriverContext("pressure", clock, world))
    source.connect()
    with pytest.raises(OutOfLimitsError, match="choose a pressure from 0 to 8 kPa"):
        source.set_pressure(8.001)
    source.set_pressure(8.0)
    assert SimulatedPressureOptions().limits_kpa == (0.0, 16.0)


def test_connecting_changes_no_pressure(clock, world, source):
    source.set_pressure(3.0)
    clock.sleep(20.0)
    source.connect()
    assert source.set_point_kpa() == 3.0
