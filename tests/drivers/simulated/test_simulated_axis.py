"""The simulated axes: the contract, and what only a simulation can tell (true position, virtual time)."""

import numpy as np
import pytest

from drivers.clock import VirtualClock
from drivers.errors import MoveStoppedError, NotConnectedError
from drivers.registry import DriverContext
from drivers.simulated import JackOptions, RotationOptions, SimulatedAxis, TranslationOptions
from drivers.simulated.options import AnyAxisOptions
from tests.drivers.contract.axis_contract import AxisContract
from tests.drivers.contract.outcome import Outcome
from tests.drivers.simulated.tiny_world import TinyWorld


def build(options: AnyAxisOptions, clock: VirtualClock, world: TinyWorld, *, home: bool = True) -> SimulatedAxis:
    axis = SimulatedAxis(options, DriverContext(options.quantity, clock, world))
    axis.connect()
    if home:
        axis.home()
    return axis


class TestRotation(AxisContract):
    @pytest.fixture
    def axis(self, clock, world):
        return SimulatedAxis(RotationOptions(), DriverContext("rotation", clock, world))

    @pytest.fixture
    def places(self):
        return (45.0, 0.0, 120.0)


class TestTranslation(AxisContract):
    @pytest.fixture
    def axis(self, clock, world):
        return SimulatedAxis(TranslationOptions(), DriverContext("translation", clock, world))

    @pytest.fixture
    def places(self):
        return (50.0, 34.0, 100.0)


class TestJack(AxisContract):
    @pytest.fixture
    def axis(self, clock, world):
        return SimulatedAxis(JackOptions(), DriverContext("jack", clock, world))

    @pytest.fixture
    def places(self):
        return (70.0, 84.0, 5.0)


class TestUnevenJack(TestJack):
    @pytest.fixture
    def axis(self, clock, world):
        options = JackOptions(lower_limits_mm=(0, 52), upper_limits_mm=(0, 32), lower_share=1.0)
        return SimulatedAxis(options, DriverContext("jack", clock, world))


@pytest.mark.parametrize(
    ("options", "quantity", "start", "home", "step", "limits", "unit"),
    [
        (RotationOptions(), "rotation_deg", 45.0, 0.0, 0.01, (-180.0, 180.0), "deg"),
        (TranslationOptions(), "translation_mm", 50.0, 0.0, 0.0025, (0.0, 100.0), "mm"),
        (JackOptions(), "jack_mm", 70.0, 0.0, 0.01, (0.0, 84.0), "mm"),
    ],
)
def test_the_three_axes_of_the_rig(clock, world, options, quantity, start, home, step, limits, unit):
    axis = build(options, clock, world, home=False)
    assert world.now(quantity) == start
    assert axis.status().position == 0.0
    assert not axis.status().homed
    axis.home()
    assert axis.status().position == home
    assert world.now(quantity) == pytest.approx(home, abs=0.05)
    info = axis.info()
    assert (info.resolution, info.unit, info.limits.low, info.limits.high) == (step, unit, *limits)


def test_homed_at_start_reads_where_it_stands(clock, world):
    axis = build(TranslationOptions(homed_at_start=True, start_mm=12.345), clock, world, home=False)
    assert axis.status().homed
    assert axis.status().position == 12.345
    axis.move_to(20.0)
    assert axis.status().position == 20.0


def test_homing_takes_distance_over_homing_speed(clock, world):
    options = TranslationOptions(start_mm=50.0, homing_speed_mm_s=2.5, acceleration_mm_s2=20.0)
    axis = build(options, clock, world, home=False)
    began_s = clock.now_s()
    axis.home()
    # v / a = 0.125 s longer than at constant speed
    assert clock.now_s() - began_s == pytest.approx(50.0 / 2.5 + 0.125, abs=1e-9)


def test_a_move_takes_exactly_as_long_as_foretold(clock, world):
    axis = build(TranslationOptions(), clock, world)
    for place in (50.0, 52.0, 52.0025, 0.0, 100.0):
        foretold_s = axis.move_duration_s(place)
        began_s = clock.now_s()
        axis.move_to(place)
        assert clock.now_s() - began_s == pytest.approx(foretold_s, abs=1e-9)
    # 100 mm at 5 mm/s, and one ramp of 5 / 20 s more
    axis.move_to(0.0)
    assert axis.move_duration_s(100.0) == pytest.approx(20.25, abs=1e-9)


def test_the_world_sees_the_way(clock, world):
    axis = build(TranslationOptions(repeatability_mm=0.0), clock, world)
    seen = []
    began_s = clock.now_s()
    for second in range(1, 20):
        clock.call_at(began_s + second, lambda: seen.append(world.now("translation_mm")))
    axis.move_to(100.0)
    # after the ramp of 0.25 s the stage is half a ramp, 0.625 mm, behind 5 mm/s
    assert seen == pytest.approx([5.0 * second - 0.625 for second in range(1, 20)], abs=1e-9)


def test_reading_is_quantised_and_the_truth_is_not(clock, world):
    axis = build(RotationOptions(repeatability_deg=0.002), clock, world)
    readings, truths = [], []
    for turn in range(400):
        axis.move_to(10.003 if turn % 2 else -3.0)
        readings.append(axis.status().position)
        truths.append(world.now("rotation_deg"))
    assert set(readings) == {10.0, -3.0}
    errors = np.array(truths) - readings
    assert len(set(errors)) == 400
    assert np.std(errors) == pytest.approx(0.002, rel=0.15)
    assert np.mean(errors) == pytest.approx(0.0, abs=0.0004)


def test_staying_redraws_no_error(clock, world):
    axis = build(TranslationOptions(), clock, world)
    axis.move_to(40.0)
    truth = world.now("translation_mm")
    axis.move_to(40.0)
    axis.move_to(40.0004)
    assert world.now("translation_mm") == truth


def test_the_truth_has_no_jump(clock, world):
    axis = build(TranslationOptions(repeatability_mm=0.05), clock, world)
    seen = []
    began_s = clock.now_s()
    for tick in range(1, 1100):
        clock.call_at(began_s + tick * 0.01, lambda: seen.append(world.now("translation_mm")))
    clock.call_at(began_s + 4.0, axis.stop)
    with pytest.raises(MoveStoppedError):
        axis.move_to(50.0)
    axis.move_to(30.0)
    clock.sleep(10.0)
    # 5 mm/s for 0.01 s, and a part of the error
    assert len(seen) == 1099
    assert np.max(np.abs(np.diff(seen))) < 0.05 + 0.01


def test_the_same_seed_gives_the_same_errors_and_each_axis_its_own(clock):
    def truth(name: str, seed: int) -> float:
        world = TinyWorld(clock)
        axis = SimulatedAxis(TranslationOptions(seed=seed), DriverContext(name, clock, world))
        axis.connect()
        axis.home()
        axis.move_to(10.0)
        return world.now("translation_mm")

    assert truth("a", 1) == truth("a", 1)
    assert len({truth("a", 1), truth("a", 2), truth("b", 1)}) == 3


@pytest.mark.parametrize(
    ("share", "height", "lower", "upper"),
    [
        (0.5, 70.0, 35.0, 35.0),
        (0.5, 84.0, 42.0, 42.0),
        (1.0, 30.0, 30.0, 0.0),
        (1.0, 70.0, 42.0, 28.0),
        (0.0, 70.0, 28.0, 42.0),
        (0.25, 40.0, 10.0, 30.0),
        (0.25, 80.0, 38.0, 42.0),
        (0.5, 0.01, 0.0, 0.01),
    ],
)
def test_a_height_is_split_between_the_jacks(clock, world, share, height, lower, upper):
    axis = build(JackOptions(lower_share=share, repeatability_mm=0.0), clock, world)
    axis.move_to(height)
    assert [carriage.state().reading for carriage in axis.carriages] == pytest.approx([lower, upper], abs=1e-9)
    assert axis.status().position == height
    assert world.now("jack_mm") == pytest.approx(height, abs=1e-9)


def test_both_jacks_move_at_once(clock, world):
    axis = build(JackOptions(), clock, world)
    axis.move_to(10.0)
    # 30 mm each at 2 mm/s, and a ramp of 2 / 4 s
    assert axis.move_duration_s(70.0) == pytest.approx(15.5, abs=1e-9)


def test_stopping_brakes_at_the_deceleration(clock, world):
    axis = build(TranslationOptions(repeatability_mm=0.0), clock, world)
    began_s = clock.now_s()
    outcome = Outcome(clock, 4.25, axis.stop)
    with pytest.raises(MoveStoppedError):
        axis.move_to(100.0)
    outcome.get()
    # 4.25 s: 20.625 mm; then v^2 / 2a = 0.625 mm in v / a = 0.25 s
    assert world.now("translation_mm") == pytest.approx(21.25, abs=1e-9)
    assert clock.now_s() - began_s == pytest.approx(4.5, abs=1e-9)


def test_a_stopped_homing_leaves_it_not_homed(clock, world):
    axis = build(TranslationOptions(), clock, world, home=False)
    outcome = Outcome(clock, 1.0, axis.stop)
    with pytest.raises(MoveStoppedError):
        axis.home()
    outcome.get()
    assert not axis.status().homed
    axis.home()
    assert axis.status().position == 0.0


def test_needs_the_twin(clock):
    with pytest.raises(NotConnectedError, match=r"rotation.*twin"):
        SimulatedAxis(RotationOptions(), DriverContext("rotation", clock))
