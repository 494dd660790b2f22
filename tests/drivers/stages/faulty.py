"""What the fault tests need: a stage with its emulator and its driver, of either maker, on either line."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from drivers.emulators.ximc import XimcEmulator
from drivers.emulators.zaber import ZaberEmulator
from drivers.errors import DeviceBusyError, DeviceTimeoutError, NotConnectedError
from drivers.simulated import SimulatedAxis
from drivers.stages.axis import StageAxis
from tests.drivers.stages.rigs import (
    MICROSTEPS_PER_UNIT,
    STEPS_PER_UNIT,
    serving,
    simulated,
    ximc_axis,
    zaber_axis,
)

SHORT_S = 0.15
"""An answer's time-out where none comes; a loaded computer may miss it where one does: see `patiently`."""
LATE_S = 3.0
LONGEST_CALL_S = 4 * SHORT_S
"""Two attempts, each with a resynchronisation."""
SLACK_S = 2.0
PATIENCE_S = 20.0
RIGS = [("ximc", "pty"), ("ximc", "tcp"), ("zaber", "pty"), ("zaber", "tcp")]
ONE_LINE_EACH = [("ximc", "pty"), ("zaber", "tcp")]
"""For faults that are the same on both lines."""


@dataclass
class Rig:
    stage: SimulatedAxis
    emulator: XimcEmulator | ZaberEmulator
    axis: StageAxis

    def truth(self) -> float:
        return self.stage.true_position()

    def restart_behind_the_line(self) -> None:
        """A power cycle that the line survives, as it does behind a serial device server."""
        if isinstance(self.emulator, XimcEmulator):
            self.emulator.controller.power_cycle()
        else:
            self.emulator.devices[0].power_cycle()


@contextmanager
def rig(maker: str, transport: Any, *, absolute: bool = False, **options: Any) -> Iterator[Rig]:
    """A stage, connected and homed: at 0, or at 0.5 mm when it is ``absolute`` and needs no homing."""
    options = {"answer_timeout_s": 1.0, "timeout_margin_s": 0.5, **options}
    if maker == "ximc":
        stage = simulated("mm", STEPS_PER_UNIT["mm"] * 256, homed_at_start=absolute)
        emulator, build = XimcEmulator(stage, "mm", transport=transport), ximc_axis
    else:
        stage = simulated("mm", MICROSTEPS_PER_UNIT["mm"], homed_at_start=absolute)
        emulator, build = ZaberEmulator([(stage, MICROSTEPS_PER_UNIT["mm"])], transport=transport), zaber_axis
    emulator.faults.late_s = LATE_S
    with serving(emulator):
        axis = build("mm", emulator.address, **options)
        try:
            patiently(axis.connect)
            if not absolute:
                patiently(axis.home)
            yield Rig(stage, emulator, axis)
        finally:
            emulator.faults.clear()
            axis.close()


def within_its_timeout(call: Callable[[], Any], longest_s: float = LONGEST_CALL_S) -> Any:
    """What a call returns; raises what it raises, and AssertionError when it takes too long."""
    began_s = time.monotonic()
    try:
        return call()
    finally:
        assert time.monotonic() - began_s < longest_s + SLACK_S


def patiently(call: Callable[[], Any]) -> Any:
    """What a call returns, made again while it is only too slow for a loaded computer."""
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return call()
        except (DeviceTimeoutError, DeviceBusyError, NotConnectedError):
            if time.monotonic() > deadline_s:
                raise
