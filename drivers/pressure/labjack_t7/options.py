"""What a pressure source behind a LabJack T7 can be told, validated."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from drivers.interfaces import Range
from drivers.modbus import Address

DAC_LIMITS_V = Range(0.0, 5.0)
RANGES_V = (10.0, 1.0, 0.1, 0.01)
LEAST_WATCHDOG_S, MOST_WATCHDOG_S = 2, 3600
"""LabJack recommends no less than 2 to 3 s."""


def _ordered(interval: tuple[float, float]) -> tuple[float, float]:
    if interval[0] >= interval[1]:
        raise ValueError(f"the limits {interval[0]:g}, {interval[1]:g} must be low, then high")
    return interval


def _on_the_network(address: str) -> str:
    if not address.startswith("tcp://"):
        raise ValueError(f"{address!r} must be tcp://HOST:PORT, for example tcp://192.168.1.30:502")
    return address


def _a_range_of_the_t7(range_v: float) -> float:
    if range_v not in RANGES_V:
        raise ValueError(f"range_v {range_v:g} must be one of {', '.join(f'{known:g}' for known in RANGES_V)}")
    return range_v


def _off_or_long_enough(watchdog_s: int) -> int:
    if watchdog_s != 0 and not LEAST_WATCHDOG_S <= watchdog_s <= MOST_WATCHDOG_S:
        raise ValueError(f"watchdog_s {watchdog_s} must be 0 (off) or {LEAST_WATCHDOG_S} to {MOST_WATCHDOG_S}")
    return watchdog_s


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Interval = Annotated[tuple[Finite, Finite], AfterValidator(_ordered)]


class TransducerOptions(BaseModel):
    """The transducer's calibration: p = (V - volts_at_zero) x kpa_per_volt, as its certificate states."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    serial: str = Field(min_length=1, description="the sensor's serial number, for the records")
    volts_at_zero: Finite = Field(description="its output at 0 kPa gauge, V")
    kpa_per_volt: Finite = Field(description="gain, kPa/V")
    range_kpa: Interval = Field(description="its range, gauge, kPa; readings a twentieth of it beyond are refused")
    noise_kpa: NotNegative = Field(default=0.005, description="one sigma of a reading, kPa")

    @model_validator(mode="after")
    def _has_a_gain(self) -> TransducerOptions:
        if self.kpa_per_volt == 0.0:
            raise ValueError("kpa_per_volt must not be 0")
        return self

    def pressure_kpa(self, volts: float) -> float:
        """Gauge pressure at an output."""
        return (volts - self.volts_at_zero) * self.kpa_per_volt

    def can_be(self, pressure_kpa: float) -> bool:
        """Whether a whole sensor can read this."""
        low, high = self.range_kpa
        margin = (high - low) / 20.0
        return Range(low - margin, high + margin).contains(pressure_kpa)


class RegulatorOptions(BaseModel):
    """The regulator's input on DAC0: V = volts_at_zero + volts_per_kpa x p."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    volts_at_zero: Finite = Field(default=0.0, description="its input at 0 kPa gauge, V")
    volts_per_kpa: Positive = Field(description="gain, V/kPa")

    def volts(self, pressure_kpa: float) -> float:
        """The input for a pressure."""
        return self.volts_at_zero + self.volts_per_kpa * pressure_kpa

    def pressure_kpa(self, volts: float) -> float:
        """The pressure at an input; 0 at and below the input for 0 kPa, also when vented."""
        return max(0.0, (volts - self.volts_at_zero) / self.volts_per_kpa)


class InputOptions(BaseModel):
    """A transducer on an analog input of a LabJack T7."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    address: Annotated[Address, AfterValidator(_on_the_network)] = Field(
        description="where the LabJack is, tcp://HOST:502"
    )
    serial_number: int | None = Field(default=None, ge=0, description="the LabJack's; refuse another one if given")
    channel: int = Field(default=0, ge=0, le=13, description="analog input of the transducer")
    range_v: Annotated[float, AfterValidator(_a_range_of_the_t7)] = Field(
        default=10.0, description="range of that input, +-10, 1, 0.1 or 0.01 V"
    )
    negative_channel: int = Field(default=199, ge=0, le=199, description="199: single-ended")
    resolution_index: int = Field(default=0, ge=0, le=12, description="0: the T7's default")
    settling_us: NotNegative = Field(default=0.0, description="settling time, microseconds; 0: the T7's default")
    transducer: TransducerOptions
    limits_kpa: Interval = Field(default=(0.0, 16.0), description="range of pressures that the rig is for, kPa")
    sample_rate_hz: float = Field(default=100.0, ge=50.0, le=1000.0, description="samples a second")
    keep_s: float = Field(default=600.0, ge=1.0, le=86400.0, description="how long samples wait to be fetched, s")
    answer_timeout_s: Positive = Field(default=0.5, description="how long an exchange waits for its answer, s")

    @model_validator(mode="after")
    def _transducer_sees_the_limits(self) -> InputOptions:
        low, high = self.transducer.range_kpa
        if not low <= self.limits_kpa[0] or not self.limits_kpa[1] <= high:
            raise ValueError(f"limits_kpa {self.limits_kpa} must lie in the transducer's range_kpa {low:g} to {high:g}")
        return self


class LabJackT7Options(InputOptions):
    """A transducer in and a regulator's set-point out of a LabJack T7."""

    regulator: RegulatorOptions
    ceiling_kpa: Finite = Field(default=17.0, description="a reading above it vents and keeps the regulator off, kPa")
    watchdog_s: Annotated[int, AfterValidator(_off_or_long_enough)] = Field(
        default=10, description="silence of the host after which the T7 vents by itself, whole seconds; 0: never"
    )

    @model_validator(mode="after")
    def _can_be_driven(self) -> LabJackT7Options:
        for limit in self.limits_kpa:
            if not DAC_LIMITS_V.contains(volts := self.regulator.volts(limit)):
                raise ValueError(f"{limit:g} kPa needs {volts:g} V of DAC0, which has 0 to 5 V")
        if self.ceiling_kpa <= self.limits_kpa[1]:
            raise ValueError(f"ceiling_kpa {self.ceiling_kpa:g} must lie above the limits' {self.limits_kpa[1]:g}")
        if not self.transducer.can_be(self.ceiling_kpa):
            raise ValueError(f"ceiling_kpa {self.ceiling_kpa:g} lies beyond what the transducer can read")
        if 0 < self.watchdog_s <= 2.0 * self.answer_timeout_s:
            raise ValueError(
                f"watchdog_s {self.watchdog_s} must be longer than twice answer_timeout_s: one lost answer"
            )
        return self
