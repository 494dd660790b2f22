"""Hundreds of moves by fractions of a step leave no error behind: each ends within half a microstep of its target.

Judged by where the emulated stage truly is, which knows neither steps nor counters.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from drivers.clock import VirtualClock
from drivers.emulators.ximc import XimcEmulator
from drivers.emulators.zaber import ZaberEmulator
from drivers.registry import DriverContext
from drivers.simulated import RotationOptions, SimulatedAxis
from drivers.stages.axis import StageAxis
from drivers.stages.ximc.entries import AXIS as XIMC
from drivers.stages.zaber.entries import AXIS as ZABER
from tests.drivers.simulated.tiny_world import TinyWorld
from tests.drivers.stages.rigs import MICROSTEPS_PER_UNIT, STEPS_PER_UNIT, serving, ximc_options, zaber_options

MOVES = 300
ZABER_SCALE = MICROSTEPS_PER_UNIT["deg"]
FAST: dict[str, Any] = {"speed": 300.0, "acceleration": 600.0}
CASES = {
    "XIMC": (256, False),
    "XIMC, reversed": (256, True),
    "XIMC, 8 microsteps": (8, False),
    "XIMC, full steps, reversed": (1, True),
    "Zaber": (None, False),
    "Zaber, reversed": (None, True),
}


@dataclass
class Rotation:
    axis: StageAxis
    stage: SimulatedAxis
    sense: int
    microstep: float

    def truth(self) -> float:
        return self.sense * self.stage.true_position()


def mechanics(counts_per_unit: float, clock: VirtualClock) -> SimulatedAxis:
    """A stage without errors of its own, whose home is the middle of its travel: half of its counts are negative."""
    options = RotationOptions(
        resolution_deg=1.0 / counts_per_unit,
        repeatability_deg=0.0,
        speed_deg_s=300.0,
        acceleration_deg_s2=600.0,
        homing_speed_deg_s=90.0,
        start_deg=12.3,
    )
    return SimulatedAxis(options, DriverContext("rotation", clock, TinyWorld(clock)))


@pytest.fixture(params=CASES)
def rotation(request) -> Iterator[Rotation]:
    """Connected and homed, in virtual time."""
    microsteps, turned = CASES[request.param]
    clock = VirtualClock()
    if microsteps is None:
        stage = mechanics(ZABER_SCALE, clock)
        emulator = ZaberEmulator([(stage, ZABER_SCALE)], transport="tcp")
        build, options, microstep = ZABER, zaber_options, 1.0 / ZABER_SCALE
    else:
        stage = mechanics(STEPS_PER_UNIT["deg"] * 256, clock)
        emulator = XimcEmulator(stage, "deg", transport="tcp")
        build, microstep = XIMC, 1.0 / (STEPS_PER_UNIT["deg"] * microsteps)

        def options(*where: str, **rest: Any) -> dict[str, Any]:
            return ximc_options(*where, **rest, microsteps=microsteps)

    with serving(emulator):
        settings = options("deg", emulator.address, reversed=turned, **FAST)
        axis = build.build(settings, DriverContext("stage", clock))
        axis.connect()
        try:
            axis.home()
            yield Rotation(axis, stage, -1 if turned else 1, microstep)
        finally:
            axis.close()


def is_at(rotation: Rotation, target: float) -> bool:
    """Whether it is truly where it was sent, to half a microstep, and says so."""
    told = rotation.axis.status().position
    nearest = round(target / rotation.microstep) * rotation.microstep
    return (
        abs(rotation.truth() - target) <= 0.5001 * rotation.microstep
        and abs(told - rotation.truth()) < 1e-6
        and told == pytest.approx(nearest, abs=1e-9)
    )


def test_moves_to_anywhere(rotation):
    targets = [-180.0, 180.0, *np.random.default_rng(2013).uniform(-20.0, 20.0, MOVES)]
    for target in targets:
        rotation.axis.move_to(target)
        assert is_at(rotation, target)


def test_small_steps_across_zero(rotation):
    """Each a fraction of a microstep or little more: what is rounded off one move is not lost to the next."""
    target = -0.45 * MOVES * rotation.microstep
    for way in np.random.default_rng(521).uniform(0.1, 1.7, MOVES) * rotation.microstep:
        target += way
        rotation.axis.move_to(target)
        assert is_at(rotation, target)
    assert target > 0.0


def test_there_and_back_again(rotation):
    for _ in range(MOVES // 4):
        for target in (-1.333333, 0.666667):
            rotation.axis.move_to(target)
            assert is_at(rotation, target)
    rotation.axis.move_to(0.0)
    assert abs(rotation.stage.true_position()) < 1e-9
