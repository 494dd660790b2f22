"""Recipes of recordings that are measured: a sphere at rest, and an inflation."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Seconds = Annotated[float, Field(ge=0.0, le=3600.0, allow_inf_nan=False)]
Kilopascals = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class _Recipe(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    exposure_s: float | None = Field(
        default=None, gt=0.0, le=60.0, description="exposure of the cameras, s; none: as set"
    )
    gain_db: float | None = Field(
        default=None, allow_inf_nan=False, description="gain of the cameras, dB; none: as set"
    )


class SphereRecipe(_Recipe):
    """Frames of a speckled sphere through the biprism, then of both cameras without it (paper, section 2.2.3)."""

    frames: int = Field(default=2, ge=1, le=1000, description="frames of a camera with the biprism raised, and lowered")
    standard_pair: bool = Field(default=True, description="record the standard stereo pair as well, biprism lowered")
    settle_s: Seconds = Field(default=0.2, description="wait after a move, s")


class InflationRecipe(_Recipe):
    """An inflation (paper, section 2.3): frames at rest, a ramp of the set-point, a hold at the top, the vent.

    The pressure follows the set-point with the regulator's lag, so the hold lets it arrive.
    """

    rest_kpa: Kilopascals = Field(default=0.05, description="gauge pressure of the reference frames, kPa")
    top_kpa: Kilopascals = Field(default=16.0, description="set-point at the end of the ramp, kPa")
    rest_frames: int = Field(default=24, ge=1, le=10_000, description="frames at rest before the ramp")
    ramp_s: float = Field(default=4.0, gt=0.0, le=86_400.0, allow_inf_nan=False, description="duration of the ramp, s")
    hold_s: Seconds = Field(default=2.5, description="frames go on for so long at the top, s")
    frame_rate_hz: float = Field(default=11.0, gt=0.0, le=10_000.0, allow_inf_nan=False, description="frames a second")
    rest_settle_s: Seconds = Field(
        default=5.0, description="wait before the first frame; a slack membrane rises 5 mm a kPa near rest, s"
    )
    rest_tolerance_kpa: float = Field(
        default=0.02, gt=0.0, allow_inf_nan=False, description="how near rest must be, kPa"
    )
    rest_timeout_s: float = Field(
        default=30.0, gt=0.0, le=3600.0, description="how long it may take to come to rest, s"
    )

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if self.top_kpa <= self.rest_kpa:
            raise ValueError(f"top_kpa = {self.top_kpa:g} must be above rest_kpa = {self.rest_kpa:g}")
        return self

    @property
    def frame_count(self) -> int:
        """Exposures that are planned."""
        return self.rest_frames + round((self.ramp_s + self.hold_s) * self.frame_rate_hz)

    def set_point_kpa(self, since_ramp_s: float) -> float:
        """The set-point so long after the ramp began: linear up to the top."""
        share = min(max(since_ramp_s / self.ramp_s, 0.0), 1.0)
        return self.rest_kpa + (self.top_kpa - self.rest_kpa) * share
