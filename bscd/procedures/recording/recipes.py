"""Recipes of recordings that are measured: a sphere at rest, and an inflation."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

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

    The pressure follows the set-point with the regulator's lag, so the hold lets it arrive. The ramp is linear, or goes
    up in ``steps``. It ends early when the pressure rises above its limit, or falls as when the membrane bursts.
    """

    rest_kpa: Kilopascals = Field(default=0.05, description="gauge pressure of the reference frames, kPa")
    top_kpa: Kilopascals = Field(default=16.0, description="set-point at the end of the ramp, kPa")
    rest_frames: int = Field(default=24, ge=1, le=10_000, description="frames at rest before the ramp")
    ramp_s: float = Field(default=4.0, gt=0.0, le=86_400.0, allow_inf_nan=False, description="duration of the ramp, s")
    steps: int = Field(default=0, ge=0, le=1000, description="equal steps of the ramp; 0: a linear ramp")
    hold_s: Seconds = Field(default=2.5, description="frames go on for so long at the top, s")
    frame_rate_hz: float = Field(default=11.0, gt=0.0, le=10_000.0, allow_inf_nan=False, description="frames a second")
    pacing: Literal["hardware", "software"] = Field(
        default="hardware", description="hardware: the camera's clock paces it; software: each frame is asked for"
    )
    readout_s: float | None = Field(
        default=None, ge=0.0, le=1.0, description="end of an exposure to the frame's arrival, s; none: not known"
    )
    limit_kpa: Kilopascals | None = Field(
        default=None, description="a pressure above it ends the inflation, kPa; none: a tenth above top_kpa, or 0.5"
    )
    burst_fall: float = Field(
        default=0.3, ge=0.0, lt=1.0, description="a fall by this share of the highest pressure ends it; 0: none does"
    )
    away_s: Seconds = Field(default=10.0, description="how long a camera that went away may be away, s")
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
        if self.limit_kpa is not None and self.limit_kpa < self.top_kpa:
            raise ValueError(f"limit_kpa = {self.limit_kpa:g} must not be below top_kpa = {self.top_kpa:g}")
        return self

    @property
    def frame_count(self) -> int:
        """Exposures that are planned."""
        return self.rest_frames + round((self.ramp_s + self.hold_s) * self.frame_rate_hz)

    @property
    def highest_kpa(self) -> float:
        """The pressure above which the inflation ends."""
        return self.limit_kpa if self.limit_kpa is not None else self.top_kpa + max(0.1 * self.top_kpa, 0.5)

    def set_point_kpa(self, since_ramp_s: float) -> float:
        """The set-point so long after the ramp began: up to the top linearly or in steps, the first one at once."""
        share = min(max(since_ramp_s / self.ramp_s, 0.0), 1.0)
        if self.steps:
            share = min(math.floor(share * self.steps) + 1, self.steps) / self.steps
        return self.rest_kpa + (self.top_kpa - self.rest_kpa) * share
