"""The LabJack's drivers and the emulated LabJack they talk to, fast enough for tests in real time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from drivers.clock import HostClock
from drivers.emulators.modbus import LabJackT7Emulator
from drivers.emulators.modbus.labjack_t7 import Wiring
from drivers.operator import Question
from drivers.pressure.labjack_t7 import LabJackT7Options, LabJackT7Pressure
from drivers.pressure.manual import ManualPressure, ManualPressureOptions
from drivers.registry import DriverContext
from drivers.simulated import SimulatedPressure, SimulatedPressureOptions
from tests.drivers.simulated.tiny_world import TinyWorld

ANSWER_TIMEOUT_S = 0.2
LAG_S = 0.03
TRANSDUCER = {
    "serial": "PT-1",
    "volts_at_zero": 0.5,
    "kpa_per_volt": 5.0,
    "range_kpa": [0.0, 20.0],
    "noise_kpa": 0.005,
}
REGULATOR = {"volts_per_kpa": 0.3125}


@dataclass
class Listener:
    """An operator who reads what they are told and does nothing."""

    told: list[str] = field(default_factory=list)

    def ask(self, question: Question) -> None:
        raise AssertionError(f"asked {question.text!r}")

    def tell(self, device: str, text: str) -> None:
        self.told.append(f"{device}: {text}")


@dataclass
class PressureRig:
    driver: LabJackT7Pressure | ManualPressure
    emulator: LabJackT7Emulator
    simulated: SimulatedPressure
    operator: Listener

    def truth_kpa(self) -> float:
        return self.simulated.true_pressure_kpa()


def settings(address: str, **changes) -> dict:
    return {"address": address, "transducer": TRANSDUCER, "answer_timeout_s": ANSWER_TIMEOUT_S, **changes}


@contextmanager
def pressure_rig(
    kind: str = "labjack_t7", *, wiring: Wiring | None = None, top_kpa: float = 16.0, **changes
) -> Iterator[PressureRig]:
    clock = HostClock()
    simulated = SimulatedPressure(
        SimulatedPressureOptions(limits_kpa=(0.0, top_kpa), lag_s=LAG_S, vent_lag_s=LAG_S),
        DriverContext("simulated pressure", clock, TinyWorld(clock)),
    )
    emulator = LabJackT7Emulator(simulated, wiring)
    emulator.start()
    operator = Listener()
    context = DriverContext("pressure", clock, operator=operator)
    driver: LabJackT7Pressure | ManualPressure
    if kind == "labjack_t7":
        wanted = settings(emulator.address, **{"regulator": REGULATOR, **changes})
        driver = LabJackT7Pressure(LabJackT7Options.model_validate(wanted), context)
    else:
        driver = ManualPressure(ManualPressureOptions.model_validate(settings(emulator.address, **changes)), context)
    try:
        yield PressureRig(driver, emulator, simulated, operator)
    finally:
        emulator.faults.clear()
        driver.close()
        emulator.stop()
