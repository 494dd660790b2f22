"""The jacks' driver and the emulated drives it talks to, fast enough for tests in real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from drivers.clock import HostClock
from drivers.emulators.modbus import ModbusJacksEmulator
from drivers.errors import DeviceError
from drivers.jacks.modbus import ModbusJacks, ModbusJacksOptions
from drivers.registry import DriverContext
from drivers.simulated import JackOptions, SimulatedAxis
from tests.drivers.contract.outcome import Outcome
from tests.drivers.simulated.tiny_world import TinyWorld

TRANSPORTS = ("tcp", "rtu")
SPEED_MM_S, ACCELERATION_MM_S2 = 30.0, 300.0
PATIENT_S = 20.0
"""An answer time-out where none is to happen: on a loaded host a pseudo terminal may hold bytes back for seconds."""
FAST_MM_S = 60.0
SPARE_S = 1.0
"""For a loaded host."""
CALLS: dict[str, Callable[[ModbusJacks], object]] = {
    "status": lambda jacks: jacks.status(),
    "home": lambda jacks: jacks.home(),
    "move_to": lambda jacks: jacks.move_to(30.0),
    "move_duration_s": lambda jacks: jacks.move_duration_s(30.0),
    "stop": lambda jacks: jacks.stop(),
}


@dataclass
class JackRig:
    driver: ModbusJacks
    emulator: ModbusJacksEmulator
    simulated: SimulatedAxis
    world: TinyWorld

    def truth_mm(self) -> float:
        return self.world.now("jack_mm")

    def ready(self) -> ModbusJacks:
        recovers(self.driver.connect)
        recovers(self.driver.home)
        return self.driver


def options(address: str, *, speed_mm_s: float = SPEED_MM_S, **changes) -> ModbusJacksOptions:
    settings = {
        "address": address,
        "serial": {"parity": "none"},
        "speed_mm_s": speed_mm_s,
        "acceleration_mm_s2": ACCELERATION_MM_S2,
        "homing_speed_mm_s": SPEED_MM_S,
        "answer_timeout_s": PATIENT_S,
        "timeout_margin_s": 10.0,
        **changes,
    }
    return ModbusJacksOptions.model_validate(settings)


@contextmanager
def jack_rig(transport: str, *, start_mm: float = 0.5, speed_mm_s: float = SPEED_MM_S, **changes) -> Iterator[JackRig]:
    clock = HostClock()
    world = TinyWorld(clock)
    mechanics = JackOptions(
        speed_mm_s=speed_mm_s,
        acceleration_mm_s2=ACCELERATION_MM_S2,
        homing_speed_mm_s=60.0,
        start_mm=start_mm,
        repeatability_mm=0.0,
    )
    simulated = SimulatedAxis(mechanics, DriverContext("simulated jack", clock, world))
    emulator = ModbusJacksEmulator(simulated, transport=transport)
    emulator.start()
    driver = ModbusJacks(options(emulator.address, speed_mm_s=speed_mm_s, **changes), DriverContext("jack", clock))
    try:
        yield JackRig(driver, emulator, simulated, world)
    finally:
        emulator.faults.clear()
        driver.close()
        emulator.stop()


def on_the_way(rig: JackRig, act: Callable[[], object]) -> Outcome:
    """Act as soon as the jacks have really set off by 2 mm."""
    start_mm = rig.truth_mm()

    def watch() -> object:
        deadline_s = time.monotonic() + 8.0
        while abs(rig.truth_mm() - start_mm) < 2.0:
            assert time.monotonic() < deadline_s, "they did not set off"
            time.sleep(0.005)
        return act()

    return Outcome(HostClock(), 0.0, watch)


def recovers(call: Callable[[], object]) -> object:
    """What a call returns as soon as it does not fail any more."""
    deadline_s = time.monotonic() + PATIENT_S
    while True:
        try:
            return call()
        except DeviceError:
            if time.monotonic() > deadline_s:
                raise


def stands_at(jacks: ModbusJacks, truth_mm: float) -> bool:
    """Whether the driver tells where the jacks truly are, to a step."""
    return abs(jacks.status().position - truth_mm) <= 0.011
