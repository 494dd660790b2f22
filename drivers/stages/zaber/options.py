"""What a Zaber stage can be told, validated; lengths are in the stage's unit, "mm" or "deg"."""

from __future__ import annotations

from pydantic import Field, model_validator

from drivers.stages.options import Finite, Positive, StageOptions
from drivers.stages.zaber.messages import native_acceleration, native_speed


class ZaberOptions(StageOptions):
    """A Zaber stage; several may share a port, each with its own address."""

    address: int = Field(default=1, ge=1, le=99, description="the device's address on its line")
    axis: int = Field(default=1, ge=1, le=9, description="the axis of that device")
    baud: int = Field(default=115200, ge=9600, le=115200, description="speed of a serial port, bit/s")
    microsteps_per_unit: Positive = Field(description="microsteps per unit, at the device's resolution")
    home_position: Finite = Field(default=0.0, description="the axis's position where the device reads 0, unit")
    homing_speed: Positive = Field(
        description="slowest speed of the search for the reference, unit/s, for its time-out; set at the device"
    )

    @model_validator(mode="after")
    def _fits_the_device(self) -> ZaberOptions:
        if native_speed(self.speed * self.microsteps_per_unit) < 1:
            raise ValueError(f"speed = {self.speed:g} is less than the device's smallest")
        if native_acceleration(self.acceleration * self.microsteps_per_unit) < 1:
            raise ValueError(f"acceleration = {self.acceleration:g} is less than the device's smallest")
        low, high = self.limits
        if not low <= self.home_position <= high:
            raise ValueError(
                f"home_position = {self.home_position:g}, where homing ends, must lie in the limits "
                f"{low:g} to {high:g}: widen the limits, or give the position where the device reads 0"
            )
        return self
