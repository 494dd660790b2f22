"""What a simulated device can be told, validated."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, RootModel, model_validator

from drivers.interfaces import Range
from drivers.simulated.carriage import CarriageSpec
from drivers.stacked import split_height


def _ordered(interval: tuple[float, float]) -> tuple[float, float]:
    if interval[0] >= interval[1]:
        raise ValueError(f"the limits {interval[0]:g}, {interval[1]:g} must be low, then high")
    return interval


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Interval = Annotated[tuple[Finite, Finite], AfterValidator(_ordered)]


class _DeviceOptions(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    seed: int = Field(default=0, ge=0, description="seed of this device's random errors; its name is mixed in")
    answer_timeout_s: Positive = Field(default=1.0, description="how long a command waits for its answer, s")


class _AxisOptions(_DeviceOptions):
    homed_at_start: bool = Field(default=False, description="true: the position is known without homing")
    timeout_factor: float = Field(
        default=1.5, ge=1.0, le=100.0, description="a move's time-out over its computed duration"
    )
    timeout_margin_s: Positive = Field(default=2.0, description="added to a move's time-out, s")


class RotationOptions(_AxisOptions):
    """The rotation stage."""

    quantity: Literal["rotation"] = Field(default="rotation", description="which axis of the twin this is")
    limits_deg: Interval = Field(default=(-180.0, 180.0), description="range of readings, deg")
    resolution_deg: Positive = Field(default=0.01, description="smallest step, deg")
    repeatability_deg: NotNegative = Field(
        default=0.002, description="one sigma of the true angle about the reading, deg"
    )
    speed_deg_s: Positive = Field(default=10.0, description="top speed, deg/s")
    acceleration_deg_s2: Positive = Field(default=20.0, description="acceleration, deg/s^2")
    homing_speed_deg_s: Positive = Field(default=5.0, description="speed of the search for the reference, deg/s")
    home_deg: Finite = Field(default=0.0, description="where the reference switch is, deg")
    start_deg: Finite = Field(default=45.0, description="where the stage stands when powered, deg")

    @model_validator(mode="after")
    def _inside(self) -> RotationOptions:
        _require_inside(self.limits_deg, home_deg=self.home_deg, start_deg=self.start_deg)
        return self

    def carriages(self) -> tuple[CarriageSpec, ...]:
        """The one motor."""
        return (
            CarriageSpec(
                limits=Range(*self.limits_deg),
                resolution=self.resolution_deg,
                repeatability=self.repeatability_deg,
                speed=self.speed_deg_s,
                acceleration=self.acceleration_deg_s2,
                homing_speed=self.homing_speed_deg_s,
                home=self.home_deg,
                start=self.start_deg,
                homed=self.homed_at_start,
            ),
        )

    def split(self, position: float) -> tuple[float, ...]:
        """Where the motor goes for the axis to be at ``position``."""
        return (position,)


class TranslationOptions(_AxisOptions):
    """The translation stage."""

    quantity: Literal["translation"] = Field(default="translation", description="which axis of the twin this is")
    limits_mm: Interval = Field(default=(0.0, 100.0), description="range of readings, mm")
    resolution_mm: Positive = Field(default=0.0025, description="smallest step, mm")
    repeatability_mm: NotNegative = Field(
        default=0.0005, description="one sigma of the true place about the reading, mm"
    )
    speed_mm_s: Positive = Field(default=5.0, description="top speed, mm/s")
    acceleration_mm_s2: Positive = Field(default=20.0, description="acceleration, mm/s^2")
    homing_speed_mm_s: Positive = Field(default=2.5, description="speed of the search for the reference, mm/s")
    home_mm: Finite = Field(default=0.0, description="where the reference switch is, mm")
    start_mm: Finite = Field(default=50.0, description="where the stage stands when powered, mm")

    @model_validator(mode="after")
    def _inside(self) -> TranslationOptions:
        _require_inside(self.limits_mm, home_mm=self.home_mm, start_mm=self.start_mm)
        return self

    def carriages(self) -> tuple[CarriageSpec, ...]:
        """The one motor."""
        return (
            CarriageSpec(
                limits=Range(*self.limits_mm),
                resolution=self.resolution_mm,
                repeatability=self.repeatability_mm,
                speed=self.speed_mm_s,
                acceleration=self.acceleration_mm_s2,
                homing_speed=self.homing_speed_mm_s,
                home=self.home_mm,
                start=self.start_mm,
                homed=self.homed_at_start,
            ),
        )

    def split(self, position: float) -> tuple[float, ...]:
        """Where the motor goes for the axis to be at ``position``."""
        return (position,)


class JackOptions(_AxisOptions):
    """The two lab jacks, one on top of the other: one axis, the sum of both heights."""

    quantity: Literal["jack"] = Field(default="jack", description="which axis of the twin this is")
    lower_limits_mm: Interval = Field(default=(0.0, 42.0), description="range of the lower jack, mm")
    upper_limits_mm: Interval = Field(default=(0.0, 42.0), description="range of the upper jack, mm")
    lower_share: float = Field(
        default=0.5,
        ge=0.0,
        le=1.0,
        description="the lower jack's part of a height, as far as its range allows; 1: it goes first",
    )
    resolution_mm: Positive = Field(default=0.01, description="smallest step of each jack, mm")
    repeatability_mm: NotNegative = Field(default=0.005, description="one sigma of each jack's true height, mm")
    speed_mm_s: Positive = Field(default=2.0, description="top speed of each jack, mm/s")
    acceleration_mm_s2: Positive = Field(default=4.0, description="acceleration of each jack, mm/s^2")
    homing_speed_mm_s: Positive = Field(default=2.0, description="speed of the search for the bottom switches, mm/s")
    start_mm: Finite = Field(default=70.0, description="height of both together when powered, mm")

    @model_validator(mode="after")
    def _inside(self) -> JackOptions:
        low = self.lower_limits_mm[0] + self.upper_limits_mm[0]
        high = self.lower_limits_mm[1] + self.upper_limits_mm[1]
        _require_inside((low, high), start_mm=self.start_mm)
        return self

    def carriages(self) -> tuple[CarriageSpec, ...]:
        """The lower jack's motor, then the upper's."""
        starts = split_height(self.start_mm, self._ranges(), self.lower_share, self.resolution_mm)
        return tuple(
            CarriageSpec(
                limits=limits,
                resolution=self.resolution_mm,
                repeatability=self.repeatability_mm,
                speed=self.speed_mm_s,
                acceleration=self.acceleration_mm_s2,
                homing_speed=self.homing_speed_mm_s,
                home=limits.low,
                start=start,
                homed=self.homed_at_start,
            )
            for limits, start in zip(self._ranges(), starts, strict=True)
        )

    def split(self, position: float) -> tuple[float, ...]:
        """Where the lower and the upper jack go for a height of ``position`` mm."""
        return split_height(position, self._ranges(), self.lower_share, self.resolution_mm)

    def _ranges(self) -> tuple[Range, Range]:
        return Range(*self.lower_limits_mm), Range(*self.upper_limits_mm)


AnyAxisOptions = RotationOptions | TranslationOptions | JackOptions


class SimulatedAxisOptions(RootModel[Annotated[AnyAxisOptions, Field(discriminator="quantity")]]):
    """One of the rig's three axes; ``quantity`` says which."""

    model_config = ConfigDict(frozen=True)


class SimulatedCameraOptions(_DeviceOptions):
    """One of the rig's two cameras."""

    camera: Literal["primary", "auxiliary"] = Field(default="primary", description="which camera of the twin this is")
    exposure_s: Positive = Field(default=0.02, description="exposure when connected, s")
    gain_db: Finite = Field(default=0.0, description="gain when connected, dB")
    frame_rate_hz: Positive = Field(default=11.0, description="frame rate of a stream when connected, Hz")
    exposure_limits_s: Interval = Field(default=(1e-5, 1.0), description="range of the exposure, s")
    gain_limits_db: Interval = Field(default=(0.0, 24.0), description="range of the gain, dB")
    frame_rate_limits_hz: Interval = Field(default=(0.1, 60.0), description="range of the frame rate, Hz")
    readout_s: NotNegative = Field(default=0.01, description="end of an exposure to the frame's arrival, s")
    buffer_frames: int = Field(
        default=16, ge=1, le=1024, description="frames held for a late reader; further ones are lost"
    )

    @model_validator(mode="after")
    def _inside(self) -> SimulatedCameraOptions:
        _require_inside(self.exposure_limits_s, exposure_s=self.exposure_s)
        _require_inside(self.gain_limits_db, gain_db=self.gain_db)
        _require_inside(self.frame_rate_limits_hz, frame_rate_hz=self.frame_rate_hz)
        if min(self.exposure_limits_s[0], self.frame_rate_limits_hz[0]) <= 0.0:
            raise ValueError("exposure_limits_s and frame_rate_limits_hz must lie above 0")
        if self.exposure_s * self.frame_rate_hz > 1.0:
            raise ValueError(f"an exposure_s of {self.exposure_s:g} does not fit {self.frame_rate_hz:g} Hz; lower one")
        return self


class SimulatedPressureOptions(_DeviceOptions):
    """The pressure source: a regulator with a first-order lag, and a transducer with noise."""

    limits_kpa: Interval = Field(default=(0.0, 16.0), description="range of set-points, gauge, kPa")
    lag_s: Positive = Field(default=0.5, description="time constant towards the set-point, s")
    vent_lag_s: Positive = Field(default=0.2, description="time constant when vented, s")
    noise_kpa: NotNegative = Field(default=0.005, description="one sigma of a reading, kPa")
    start_kpa: Finite = Field(default=0.0, description="pressure when powered, gauge, kPa")


def _require_inside(limits: tuple[float, float], **values: float) -> None:
    for name, value in values.items():
        if not limits[0] <= value <= limits[1]:
            raise ValueError(f"{name} = {value:g} must lie in the limits {limits[0]:g} to {limits[1]:g}")
