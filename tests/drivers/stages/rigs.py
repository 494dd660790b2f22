"""Fast simulated stages behind the emulators, and the drivers for them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from drivers.clock import HostClock
from drivers.emulators.emulator import Emulator
from drivers.emulators.ximc import XimcEmulator
from drivers.emulators.zaber import ZaberEmulator
from drivers.registry import DriverContext
from drivers.simulated import RotationOptions, SimulatedAxis, TranslationOptions
from drivers.stages.axis import StageAxis
from drivers.stages.ximc.entries import AXIS as XIMC
from drivers.stages.zaber.entries import AXIS as ZABER
from tests.drivers.simulated.tiny_world import TinyWorld

SPEED = 10.0
ACCELERATION = 160.0
HOMING_SPEED = 400.0
STEPS_PER_UNIT = {"mm": 400.0, "deg": 100.0}
MICROSTEPS_PER_UNIT = {"mm": 1.0 / 0.047625e-3, "deg": 768000.0 / 180.0}
"""Of the X-LSM and the X-RSW series."""
LIMITS = {"mm": (0.0, 100.0), "deg": (-180.0, 180.0)}


def simulated(unit: str, counts_per_unit: float, **options: Any) -> SimulatedAxis:
    """A stage in real time, whose smallest step is a count."""
    clock = HostClock()
    world = TinyWorld(clock)
    if unit == "mm":
        mechanics = TranslationOptions(
            resolution_mm=1.0 / counts_per_unit,
            repeatability_mm=0.0,
            speed_mm_s=SPEED,
            acceleration_mm_s2=ACCELERATION,
            homing_speed_mm_s=HOMING_SPEED,
            start_mm=options.pop("start", 0.5),
            **options,
        )
        return SimulatedAxis(mechanics, DriverContext("translation", clock, world))
    mechanics = RotationOptions(
        resolution_deg=1.0 / counts_per_unit,
        repeatability_deg=0.0,
        speed_deg_s=SPEED,
        acceleration_deg_s2=ACCELERATION,
        homing_speed_deg_s=HOMING_SPEED,
        start_deg=options.pop("start", 0.5),
        **options,
    )
    return SimulatedAxis(mechanics, DriverContext("rotation", clock, world))


Served = TypeVar("Served", bound=Emulator)


@contextmanager
def serving(emulator: Served) -> Iterator[Served]:
    emulator.start()
    try:
        yield emulator
    finally:
        emulator.stop()


def ximc_emulator(unit: str, transport: Any, **options: Any) -> XimcEmulator:
    return XimcEmulator(simulated(unit, STEPS_PER_UNIT[unit] * 256, **options), unit, transport=transport)


def ximc_options(unit: str, port: str, **options: Any) -> dict[str, Any]:
    return {
        "port": port,
        "unit": unit,
        "limits": LIMITS[unit],
        "speed": SPEED,
        "acceleration": ACCELERATION,
        "answer_timeout_s": 2.0,
        "steps_per_unit": STEPS_PER_UNIT[unit],
        "homing": {"fast_speed": HOMING_SPEED, "slow_speed": 20.0},
        **options,
    }


def ximc_axis(unit: str, port: str, **options: Any) -> StageAxis:
    return XIMC.build(ximc_options(unit, port, **options), DriverContext("stage"))


def zaber_emulator(*units: str, transport: Any, **options: Any) -> ZaberEmulator:
    stages = [(simulated(unit, MICROSTEPS_PER_UNIT[unit], **options), MICROSTEPS_PER_UNIT[unit]) for unit in units]
    return ZaberEmulator(stages, transport=transport)


def zaber_options(unit: str, port: str, **options: Any) -> dict[str, Any]:
    return {
        "port": port,
        "unit": unit,
        "limits": LIMITS[unit],
        "speed": SPEED,
        "acceleration": ACCELERATION,
        "answer_timeout_s": 2.0,
        "microsteps_per_unit": MICROSTEPS_PER_UNIT[unit],
        "homing_speed": HOMING_SPEED,
        **options,
    }


def zaber_axis(unit: str, port: str, **options: Any) -> StageAxis:
    return ZABER.build(zaber_options(unit, port, **options), DriverContext("stage"))
