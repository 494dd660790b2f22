"""Transducer in, regulator's set-point out: a pressure source on a LabJack T7."""

from __future__ import annotations

import logging
import threading
from contextlib import suppress

from drivers.errors import DeviceError, DeviceFaultError, OutOfLimitsError
from drivers.interfaces import PressureInfo, PressureReading, PressureReadings, Range
from drivers.pressure.labjack_t7.options import LabJackT7Options
from drivers.pressure.labjack_t7.transducer import Transducer
from drivers.pressure.labjack_t7.watchdog import Watchdog
from drivers.registry import DriverContext

VENT_V = 0.0
VENT_ATTEMPTS = 2
_LOG = logging.getLogger(__name__)


class LabJackT7Pressure:
    """See `drivers.interfaces.SampledPressureSource`; ``docs/drivers/labjack-t7.md`` says how to wire it.

    A sample above the ceiling, or one that a whole transducer can not read, vents at once; no pressure can be set
    until somebody has called `vent`. The T7's own watchdog is armed by the first pressure above 0 V and disarmed by
    `close` once vented; between, at 0 V, it can do no harm, and `vent` has nothing to wait for but DAC0. A T7 serves
    two programs: one that only looks leaves what the other has set.
    """

    def __init__(self, options: LabJackT7Options, context: DriverContext) -> None:
        self.name = context.name
        self._options = options
        self._limits_kpa = Range(*options.limits_kpa)
        self._setting = threading.RLock()
        self._tripped = ""
        self._has_set = False
        self._transducer = Transducer(context.name, options, context.clock, self._watch)
        self._watchdog = Watchdog(context.name, self._transducer.labjack, options.watchdog_s)

    @property
    def sample_rate_hz(self) -> float:
        """Samples a second."""
        return self._options.sample_rate_hz

    def connect(self) -> None:
        """Find the LabJack and begin to sample; changes no pressure."""
        self._transducer.connect()

    def close(self) -> None:
        """Vent and disarm the watchdog, as far as the LabJack answers, and close the connection.

        Neither is done where this object has set no pressure, armed nothing and not tripped.
        """
        self._transducer.close(self._vent_or_log)

    def info(self) -> PressureInfo:
        """Identity and capabilities."""
        return self._transducer.info("T7 with regulator", can_set=True)

    def read(self) -> PressureReading:
        """The transducer now."""
        return self._transducer.read("reading the pressure")

    def readings_since(self, host_time_ns: int) -> PressureReadings:
        """The samples taken after ``host_time_ns``."""
        return self._transducer.readings_since(host_time_ns)

    def set_point_kpa(self) -> float:
        """What DAC0 is set to, as a pressure; 0 when vented."""
        volts = self._transducer.labjack.dac_volts("reading the set-point")
        return self._options.regulator.pressure_kpa(volts)

    def set_pressure(self, pressure_kpa: float) -> None:
        """Arm the watchdog, set DAC0, read it back and return.

        Raises `OutOfLimitsError` first, `DeviceFaultError` after a trip, and `UnsupportedError`, with DAC0 as it was,
        when there is to be a watchdog and the firmware has none.
        """
        doing = f"setting {pressure_kpa:g} kPa"
        self._transducer.labjack.line.require_open(doing)
        if not self._limits_kpa.contains(pressure_kpa):
            allowed = f"{self._limits_kpa.low:g} to {self._limits_kpa.high:g} kPa"
            raise OutOfLimitsError(self.name, f"{doing}: outside its limits", f"choose a pressure from {allowed}")
        low_v, high_v = (self._options.regulator.volts(limit) for limit in self._options.limits_kpa)
        volts = min(max(self._options.regulator.volts(pressure_kpa), low_v), high_v)
        if volts > VENT_V:
            self._watchdog.arm(doing)  # what may take long, while a vent need not wait for it
        with self._setting:
            if self._tripped:
                raise DeviceFaultError(self.name, f"{doing}: {self._tripped}", "find the cause, then vent it")
            if volts > VENT_V:
                self._watchdog.arm(doing)  # nothing to do, unless `close` came between
            self._has_set = True  # also when the answer is lost
            self._transducer.labjack.set_dac_volts(volts, doing)

    def vent(self) -> None:
        """Set DAC0 to 0 V and see that it is; also takes a trip back."""
        with self._setting:
            self._vent("venting")
            self._tripped = ""

    def _vent(self, doing: str) -> None:
        for attempt in range(VENT_ATTEMPTS):
            try:
                self._transducer.labjack.set_dac_volts(VENT_V, doing)
                return
            except DeviceError:
                if attempt == VENT_ATTEMPTS - 1:
                    raise

    def _vent_or_log(self) -> None:
        with self._setting:
            if not (self._has_set or self._tripped or self._watchdog.is_armed):
                return
            try:
                self.vent()
                self._has_set = False
            except DeviceError as error:
                by_itself = f"; the T7 vents {self._watchdog.timeout_s} s after" if self._watchdog.is_armed else ""
                _LOG.warning("closed without venting: %s%s", error, by_itself)
                return
            try:
                self._watchdog.disarm("closing")
            except DeviceError as error:
                _LOG.warning("vented, and closed with the watchdog armed: %s", error)

    def _watch(self, sample: PressureReading | DeviceError) -> None:
        """Vent when the pressure is too high or the transducer is broken; with every sample, whoever else sets it."""
        if isinstance(sample, PressureReading):
            if sample.pressure_kpa <= self._options.ceiling_kpa:
                return
            ceiling = f"the ceiling of {self._options.ceiling_kpa:g} kPa"
            reason = f"vented at {sample.pressure_kpa:.2f} kPa, above {ceiling}"
        elif isinstance(sample, DeviceFaultError):
            reason = f"vented because the transducer can not be right ({sample.doing})"
        else:
            return
        with self._setting, suppress(DeviceError):
            if not self._tripped:
                self._tripped = reason
                _LOG.warning("%s: %s", self.name, reason)
            self._vent(reason)
