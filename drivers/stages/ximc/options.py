"""What an XIMC stage can be told, validated; lengths are in the stage's unit, "mm" or "deg"."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from drivers.stages.options import Finite, NotNegative, Positive, StageOptions

MicrostepDivision = Literal[1, 2, 4, 8, 16, 32, 64, 128, 256]
MOST_STEPS = 2**31 - 1


class HomingRecipe(BaseModel):
    """How the controller finds the reference: fast to a stop, perhaps slowly to a second one, then a shift."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    direction: Literal["left", "right"] = Field(default="left", description="the motor's way to the first stop")
    stop_at: Literal["limit", "sync", "revolution"] = Field(
        default="limit", description="what ends the way: limit switch, synchronisation input, revolution sensor"
    )
    second: bool = Field(default=False, description="true: go to a second stop, slowly")
    second_direction: Literal["left", "right"] = Field(
        default="right", description="the motor's way to the second stop"
    )
    second_stop_at: Literal["limit", "sync", "revolution"] = Field(
        default="limit", description="what ends the way to the second stop"
    )
    half_turn: bool = Field(
        default=False, description="true: the second stop is not looked at in the first half turn of the motor"
    )
    fast_algorithm: bool = Field(default=False, description="true: the controller's own fast algorithm")
    fast_speed: Positive = Field(description="speed to the first stop, unit/s")
    slow_speed: Positive = Field(description="speed to the second stop, unit/s")
    slow_travel: NotNegative = Field(default=1.0, description="the longest way to the second stop, unit, for time-outs")
    shift: Finite = Field(default=0.0, description="the motor's way after the last stop, unit, to the right positive")
    position: Finite = Field(default=0.0, description="the axis's position there, unit")


class XimcOptions(StageOptions):
    """A stage on an XIMC controller."""

    steps_per_unit: Positive = Field(description="full steps of the motor per unit")
    microsteps: MicrostepDivision = Field(default=256, description="microsteps per full step")
    backlash: Finite = Field(
        default=0.0, description="play, unit: every move ends in one sense, after this way at least; 0: no care"
    )
    backlash_speed: Positive | None = Field(
        default=None, description="speed of that last way, unit/s; none: half the speed"
    )
    homing: HomingRecipe = Field(description="how the reference is found")

    @model_validator(mode="after")
    def _fits_the_controller(self) -> XimcOptions:
        for name, value in {
            "speed": self.speed,
            "homing.fast_speed": self.homing.fast_speed,
            "homing.slow_speed": self.homing.slow_speed,
            "backlash_speed": self.backlash_speed or self.speed / 2.0,
        }.items():
            if value * self.steps_per_unit * self.microsteps < 1.0:
                raise ValueError(f"{name} = {value:g} is less than a microstep per second")
        if not 1 <= round(self.acceleration * self.steps_per_unit) <= 65535:
            raise ValueError(f"acceleration = {self.acceleration:g} must be 1 to 65535 steps/s^2")
        if abs(self.backlash * self.steps_per_unit) > 32767:
            raise ValueError(f"backlash = {self.backlash:g} must be 32767 steps at most")
        low, high = self.limits
        if max(abs(low), abs(high)) * self.steps_per_unit > MOST_STEPS:
            raise ValueError("the limits lie beyond what the controller can count")
        if not low <= self.homing.position <= high:
            raise ValueError(f"homing.position = {self.homing.position:g} must lie in the limits {low:g} to {high:g}")
        return self
