"""What the replay camera can be told, validated."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from bscd.acquisition.names import CameraName, PhaseName

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class ReplayOptions(BaseModel):
    """What is played back, and how fast."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    source: Path = Field(description="a run file, or a folder of images that are shown in the order of their names")
    camera: CameraName = Field(default="primary", description="whose frames of a run are shown")
    phase: PhaseName | None = Field(default=None, description="which frames of a run are shown; none: all")
    pace: Literal["rate", "recorded", "fast"] = Field(
        default="rate", description="rate: at frame_rate_hz; recorded: as far apart as a run's were; fast: at once"
    )
    repeat: bool = Field(default=False, description="begin again at the end; otherwise reading on times out there")
    exposure_s: Positive = Field(default=0.02, description="exposure that is told where the recording does not, s")
    gain_db: float = Field(default=0.0, allow_inf_nan=False, description="gain that is told, dB")
    frame_rate_hz: Positive = Field(default=11.0, description="frame rate, Hz")
    pixel_size_mm: Positive | None = Field(default=None, description="edge of a pixel, mm; none: as the run tells")
    bit_depth: int | None = Field(
        default=None, ge=8, le=16, description="bits of a pixel; none: as the run tells, or 8 or 16 as the files have"
    )

    @model_validator(mode="after")
    def _possible(self) -> ReplayOptions:
        if self.exposure_s * self.frame_rate_hz > 1.0:
            raise ValueError(f"an exposure_s of {self.exposure_s:g} does not fit {self.frame_rate_hz:g} Hz; lower one")
        return self
