"""The pressure source on the twin: a regulator with a first-order lag and a transducer with noise."""

from __future__ import annotations

import math
import threading
import zlib
from contextlib import suppress

import numpy as np

from drivers.errors import DeviceError, OutOfLimitsError
from drivers.interfaces import PressureInfo, PressureReading, Range
from drivers.registry import DriverContext
from drivers.simulated.faults import Fault, Faults
from drivers.simulated.link import Link
from drivers.simulated.options import SimulatedPressureOptions
from drivers.simulated.world import world_of


class SimulatedPressure:
    """A pressure regulator with its transducer; see `drivers.interfaces.PressureSource`.

    Attributes
    ----------
    faults : Faults
        Where faults are injected.
    """

    def __init__(self, options: SimulatedPressureOptions, context: DriverContext) -> None:
        self.name = context.name
        self.faults = Faults(context.name, [Fault.NO_ANSWER])
        self._options = options
        self._clock = context.clock
        self._limits_kpa = Range(*options.limits_kpa)
        self._link = Link(context.name, context.clock, self.faults, options.answer_timeout_s)
        self._rng = np.random.default_rng([options.seed, zlib.crc32(context.name.encode())])
        self._lock = threading.Lock()
        self._set_point_kpa = options.start_kpa
        self._from_kpa = self._towards_kpa = options.start_kpa
        self._lag_s = options.lag_s
        self._since_s = context.clock.now_s()
        world_of(context).bind("pressure_kpa", self.true_pressure_kpa)

    @property
    def limits_kpa(self) -> Range:
        """Range of its set-points, gauge."""
        return self._limits_kpa

    def connect(self) -> None:
        """Open the connection; changes no pressure."""
        self._link.open()

    def close(self) -> None:
        """Vent, as far as the device answers, and close the connection."""
        if self._link.is_open:
            with suppress(DeviceError):
                self.vent()
            self._link.close()

    def info(self) -> PressureInfo:
        """Identity and capabilities."""
        self._link.ask("asking for its identity")
        return PressureInfo(
            vendor="bscd",
            model="digital twin pressure source",
            serial=f"twin-{self.name}",
            limits_kpa=self._limits_kpa,
            noise_kpa=self._options.noise_kpa,
            can_set=True,
        )

    def read(self) -> PressureReading:
        """The transducer now."""
        self._link.ask("reading the pressure")
        with self._lock:
            true_kpa, now_s = self._true_kpa(), self._clock.now_s()
            noise_kpa = float(self._rng.normal(0.0, self._options.noise_kpa))
        return PressureReading(pressure_kpa=true_kpa + noise_kpa, host_time_ns=round(now_s * 1e9))

    def set_point_kpa(self) -> float:
        """The last pressure asked for; 0 when vented."""
        self._link.ask("reading the set-point")
        with self._lock:
            return self._set_point_kpa

    def set_pressure(self, pressure_kpa: float) -> None:
        """Ask the regulator for a pressure and return at once. Raises `OutOfLimitsError` first."""
        doing = f"setting {pressure_kpa:g} kPa"
        self._link.require_open(doing)
        if not self._limits_kpa.contains(pressure_kpa):
            allowed = f"{self._limits_kpa.low:g} to {self._limits_kpa.high:g} kPa"
            raise OutOfLimitsError(self.name, f"{doing}: outside its limits", f"choose a pressure from {allowed}")
        self._link.ask(doing)
        self._go_towards(pressure_kpa, self._options.lag_s)

    def vent(self) -> None:
        """Open to the room."""
        self._link.ask("venting")
        self._go_towards(0.0, self._options.vent_lag_s)

    def true_pressure_kpa(self) -> float:
        """What the pressure really is, gauge; the world sees this one."""
        with self._lock:
            return self._true_kpa()

    def _go_towards(self, pressure_kpa: float, lag_s: float) -> None:
        with self._lock:
            self._from_kpa, self._since_s = self._true_kpa(), self._clock.now_s()
            self._set_point_kpa = self._towards_kpa = pressure_kpa
            self._lag_s = lag_s

    def _true_kpa(self) -> float:
        """p(t) = p1 + (p0 - p1) exp(-t / lag), the first-order lag's step response; the lock is held."""
        decay = math.exp(-(self._clock.now_s() - self._since_s) / self._lag_s)
        return self._towards_kpa + (self._from_kpa - self._towards_kpa) * decay
