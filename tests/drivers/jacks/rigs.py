"""The jacks' driver and the emulated drives it talks to, fast enough for tests in real time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from drivers.clock import HostClock
from drivers.emulators.modbus import ModbusJacksEmulator
from drivers.jacks.modbus import ModbusJacks, ModbusJacksOptions
from drivers.registry import DriverContext
from drivers.simulated import JackOptions, SimulatedAxis
from tests.drivers.simulated.tiny_world import TinyWorld

TRANSPORTS = ("tcp", "rtu")
SPEED_MM_S, ACCELERATION_MM_S2 = 30.0, 300.0
ANSWER_TIMEOUT_S = 0.2


@dataclass
class JackRig:
    driver: ModbusJacks
    emulator: ModbusJacksEmulator
    simulated: SimulatedAxis
    world: TinyWorld

    def truth_mm(self) -> float:
        return self.world.now("jack_mm")

    def ready(self) -> ModbusJacks:
        self.driver.connect()
        self.driver.home()
        return self.driver


def options(address: str, **changes) -> ModbusJacksOptions:
    settings = {
        "address": address,
        "serial": {"parity": "none"},
        "speed_mm_s": SPEED_MM_S,
        "acceleration_mm_s2": ACCELERATION_MM_S2,
        "homing_speed_mm_s": SPEED_MM_S,
        "answer_timeout_s": ANSWER_TIMEOUT_S,
        "timeout_margin_s": 0.5,
        **changes,
    }
    return ModbusJacksOptions.model_validate(settings)


@contextmanager
def jack_rig(transport: str, *, start_mm: float = 4.0, **changes) -> Iterator[JackRig]:
    clock = HostClock()
    world = TinyWorld(clock)
    mechanics = JackOptions(
        speed_mm_s=SPEED_MM_S,
        acceleration_mm_s2=ACCELERATION_MM_S2,
        homing_speed_mm_s=60.0,
        start_mm=start_mm,
        repeatability_mm=0.0,
    )
    simulated = SimulatedAxis(mechanics, DriverContext("simulated jack", clock, world))
    emulator = ModbusJacksEmulator(simulated, transport=transport)
    emulator.start()
    driver = ModbusJacks(options(emulator.address, **changes), DriverContext("jack", clock))
    try:
        yield JackRig(driver, emulator, simulated, world)
    finally:
        emulator.faults.clear()
        driver.close()
        emulator.stop()
