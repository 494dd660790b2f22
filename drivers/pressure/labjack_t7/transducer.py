"""A transducer on a LabJack T7: read at once, or sampled; what the source with and without a regulator share."""

from __future__ import annotations

import threading
from collections.abc import Callable

from drivers.clock import Clock
from drivers.errors import DeviceBusyError, DeviceError, DeviceFaultError, NotConnectedError
from drivers.interfaces import PressureInfo, PressureReading, PressureReadings, Range
from drivers.pressure.labjack_t7.device import LabJackT7
from drivers.pressure.labjack_t7.options import InputOptions
from drivers.pressure.labjack_t7.sampler import Sampler
from drivers.pressure.readings import ReadingRing


class Transducer:
    """Connected, it samples; safe to use from any thread.

    Parameters
    ----------
    device : str
        Name of the device, for messages.
    options : InputOptions
        Where it is and what its volts mean.
    clock : Clock
        The frames' clock.
    watch : callable
        Sees every sample, or the error in its place, on the sampler's thread.
    """

    def __init__(
        self, device: str, options: InputOptions, clock: Clock, watch: Callable[[PressureReading | DeviceError], None]
    ) -> None:
        self.labjack = LabJackT7(device, options, clock)
        self._device = device
        self._options = options
        self._changing = threading.Lock()
        self._ring = ReadingRing(max(1, round(options.keep_s * options.sample_rate_hz)))
        self._sampler = Sampler(
            device, clock, options.sample_rate_hz, self._ring, lambda: self.read("sampling the pressure"), watch
        )

    def connect(self) -> None:
        """Find the LabJack, set its input up and begin to sample. Raises `NotConnectedError`, `DeviceBusyError`."""
        with self._changing:
            if self.labjack.line.is_open:
                return
            try:
                self.labjack.line.open()
            except (NotConnectedError, DeviceBusyError):
                raise
            except DeviceError as error:
                raise NotConnectedError(self._device, f"connecting: {error.doing}", error.hint) from error
            self._sampler.start()

    def close(self, last: Callable[[], None]) -> None:
        """End sampling, do what is to be done ``last``, and close the connection; does nothing when closed."""
        with self._changing:
            if self.labjack.line.is_open:
                self._sampler.stop()
                last()
                self.labjack.line.close()

    def info(self, model: str, can_set: bool) -> PressureInfo:
        """Identity and capabilities. Raises `NotConnectedError`."""
        self.labjack.line.require_open("asking for its identity")
        transducer = self._options.transducer
        return PressureInfo(
            vendor="LabJack",
            model=model,
            serial=f"T7 {self.labjack.serial}, transducer {transducer.serial}",
            limits_kpa=Range(*self._options.limits_kpa),
            noise_kpa=transducer.noise_kpa,
            can_set=can_set,
            firmware=self.labjack.firmware,
        )

    def read(self, doing: str) -> PressureReading:
        """The pressure now, timed in the middle of the exchange.

        Raises `DeviceFaultError` for what a whole sensor can not read.
        """
        volts, time_s = self.labjack.volts(doing)
        pressure_kpa = self._options.transducer.pressure_kpa(volts)
        if not self._options.transducer.can_be(pressure_kpa):
            words = f"{doing}: {volts:.4g} V would be {pressure_kpa:.4g} kPa, outside the transducer's range"
            raise DeviceFaultError(self._device, words, "check its supply and its wiring")
        return PressureReading(pressure_kpa, round(time_s * 1e9))

    def readings_since(self, host_time_ns: int) -> PressureReadings:
        """See `drivers.interfaces.SampledPressureSource`."""
        self.labjack.line.require_open("fetching readings")
        return self._ring.since(host_time_ns)
