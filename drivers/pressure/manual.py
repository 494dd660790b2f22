"""A transducer on a LabJack T7, and a person at the regulator."""

from __future__ import annotations

from drivers.errors import DeviceError, OutOfLimitsError, UnsupportedError
from drivers.interfaces import PressureInfo, PressureReading, PressureReadings, Range
from drivers.pressure.labjack_t7 import InputOptions, Transducer
from drivers.registry import DriverContext, DriverEntry


class ManualPressureOptions(InputOptions):
    """A transducer on a LabJack T7; the operator turns the regulator."""


class ManualPressure:
    """See `drivers.interfaces.SampledPressureSource`; it reads, and can not set.

    Venting is told to the operator where there is one; nothing waits for it.
    """

    def __init__(self, options: ManualPressureOptions, context: DriverContext) -> None:
        self.name = context.name
        self._options = options
        self._operator = context.operator
        self._limits_kpa = Range(*options.limits_kpa)
        self._told = False
        self._transducer = Transducer(context.name, options, context.clock, self._watch)

    @property
    def sample_rate_hz(self) -> float:
        """Samples a second."""
        return self._options.sample_rate_hz

    def connect(self) -> None:
        """Find the LabJack and begin to sample."""
        self._transducer.connect()

    def close(self) -> None:
        """Tell the operator to vent, and close the connection."""
        self._transducer.close(self._tell_to_vent)

    def info(self) -> PressureInfo:
        """Identity and capabilities."""
        return self._transducer.info("T7, regulator turned by hand", can_set=False)

    def read(self) -> PressureReading:
        """The transducer now."""
        return self._transducer.read("reading the pressure")

    def readings_since(self, host_time_ns: int) -> PressureReadings:
        """The samples taken after ``host_time_ns``."""
        return self._transducer.readings_since(host_time_ns)

    def set_point_kpa(self) -> float:
        """0: nothing was ever asked for."""
        self._transducer.labjack.line.require_open("reading the set-point")
        return 0.0

    def set_pressure(self, pressure_kpa: float) -> None:
        """Raises `OutOfLimitsError` for what the rig must never see, and `UnsupportedError` for the rest."""
        doing = f"setting {pressure_kpa:g} kPa"
        self._transducer.labjack.line.require_open(doing)
        if not self._limits_kpa.contains(pressure_kpa):
            allowed = f"{self._limits_kpa.low:g} to {self._limits_kpa.high:g} kPa"
            raise OutOfLimitsError(self.name, f"{doing}: outside its limits", f"choose a pressure from {allowed}")
        raise UnsupportedError(self.name, f"{doing}: its regulator is turned by hand", "ask the operator to turn it")

    def vent(self) -> None:
        """Tell the operator to vent. Raises `NotConnectedError`, and `UnsupportedError` when there is no operator."""
        self._transducer.labjack.line.require_open("venting")
        if self._operator is None:
            raise UnsupportedError(
                self.name, "venting: there is no operator to tell", "turn the regulator back by hand"
            )
        self._tell_to_vent()

    def _tell_to_vent(self) -> None:
        if self._operator is not None:
            self._operator.tell(self.name, "vent: turn the regulator back to 0 and open the valve")

    def _watch(self, sample: PressureReading | DeviceError) -> None:
        """Tell the operator once when the pressure leaves the limits."""
        if not isinstance(sample, PressureReading):
            return
        high = sample.pressure_kpa > self._limits_kpa.high
        if high and not self._told and self._operator is not None:
            words = f"{sample.pressure_kpa:.2f} kPa is above the limit of {self._limits_kpa.high:g} kPa: turn back"
            self._operator.tell(self.name, words)
        self._told = high


PRESSURE = DriverEntry(
    "pressure", ManualPressureOptions, ManualPressure, "a transducer on a LabJack T7; the regulator is turned by hand"
)
