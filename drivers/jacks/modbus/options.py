"""What the Modbus jacks can be told, validated."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from drivers.interfaces import Range
from drivers.jacks.modbus.register_map import load_register_map
from drivers.modbus import Address, SerialSettings


def _ordered(interval: tuple[float, float]) -> tuple[float, float]:
    if interval[0] >= interval[1]:
        raise ValueError(f"the limits {interval[0]:g}, {interval[1]:g} must be low, then high")
    return interval


def _can_be_loaded(name: str) -> str:
    load_register_map(name)
    return name


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Interval = Annotated[tuple[Finite, Finite], AfterValidator(_ordered)]


class ModbusJackOptions(BaseModel):
    """One of the two jacks."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    unit: int = Field(ge=1, le=247, description="Modbus address of its drive")
    limits_mm: Interval = Field(default=(0.0, 42.0), description="range of its height, mm")
    steps_per_mm: Positive = Field(default=100.0, description="steps of its drive per mm of height")
    height_at_zero_mm: Finite = Field(default=0.0, description="its height where its drive reads 0, mm")

    @model_validator(mode="after")
    def _homes_within_its_limits(self) -> ModbusJackOptions:
        low, high = self.limits_mm
        if not low <= self.height_at_zero_mm <= high:
            raise ValueError(
                f"height_at_zero_mm = {self.height_at_zero_mm:g}, where homing ends, must lie in limits_mm, "
                f"{low:g} to {high:g}: widen the limits, or move the drive's home and give its height here"
            )
        return self

    @property
    def range_mm(self) -> Range:
        """Range of its height."""
        return Range(*self.limits_mm)

    def steps(self, height_mm: float) -> int:
        """The whole step within the limits that is nearest to a height."""
        low, high = (self._exact(limit) for limit in self.limits_mm)
        return min(max(round(self._exact(height_mm)), math.ceil(low)), math.floor(high))

    def height_mm(self, steps: int) -> float:
        """The height at a step."""
        return self.height_at_zero_mm + steps / self.steps_per_mm

    def _exact(self, height_mm: float) -> float:
        return round((height_mm - self.height_at_zero_mm) * self.steps_per_mm, 6)


class ModbusJacksOptions(BaseModel):
    """The two lab jacks, one on top of the other, with a Modbus drive each: one axis, the sum of both heights."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    address: Address = Field(description="serial port (/dev/ttyUSB0) for Modbus RTU, tcp://HOST:PORT for Modbus TCP")
    serial: SerialSettings = Field(default=SerialSettings(), description="how the serial port talks")
    register_map: Annotated[str, AfterValidator(_can_be_loaded)] = Field(
        default="oriental-az", description="name of a shipped register map, or the path of a .toml file"
    )
    lower: ModbusJackOptions = Field(default=ModbusJackOptions(unit=1), description="the lower jack")
    upper: ModbusJackOptions = Field(
        default=ModbusJackOptions(unit=2), description="the upper jack, on top of the lower one"
    )
    lower_share: float = Field(
        default=0.5,
        ge=0.0,
        le=1.0,
        description="the lower jack's part of a height, as far as its range allows; 1: it goes first",
    )
    speed_mm_s: Positive = Field(default=2.0, description="top speed of each jack, mm/s")
    acceleration_mm_s2: Positive = Field(default=4.0, description="acceleration and deceleration of each jack, mm/s^2")
    homing_speed_mm_s: Positive = Field(default=1.0, description="slowest speed of homing, as the drives are set, mm/s")
    repeatability_mm: float = Field(
        default=0.005, ge=0.0, allow_inf_nan=False, description="one sigma of a true height about its reading, mm"
    )
    in_position_mm: Positive = Field(default=0.02, description="how far from its target a jack may come to rest, mm")
    answer_timeout_s: Positive = Field(default=0.5, description="how long an exchange waits for its answer, s")
    timeout_factor: float = Field(
        default=1.5, ge=1.0, le=100.0, description="a move's time-out over its computed duration"
    )
    timeout_margin_s: Positive = Field(default=2.0, description="added to a move's time-out, s")

    @model_validator(mode="after")
    def _two_drives(self) -> ModbusJacksOptions:
        if self.lower.unit == self.upper.unit:
            raise ValueError(f"both drives have the address {self.lower.unit}; give each its own")
        return self

    @property
    def jacks(self) -> tuple[ModbusJackOptions, ModbusJackOptions]:
        """The lower jack, then the upper one."""
        return self.lower, self.upper

    @property
    def limits_mm(self) -> Range:
        """Range of both heights together."""
        low, high = (sum(jack.limits_mm[end] for jack in self.jacks) for end in (0, 1))
        return Range(low, high)
