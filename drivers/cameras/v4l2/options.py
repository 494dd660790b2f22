"""What the V4L2 driver can be told, validated."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]

FourCC = Literal["GREY", "Y10 ", "Y12 ", "Y16 ", "YUYV", "MJPG"]

BITS: dict[str, int] = {"GREY": 8, "Y10 ": 10, "Y12 ": 12, "Y16 ": 16, "YUYV": 8, "MJPG": 8}
"""Bits of a pixel's grey level in each format."""


class V4l2Options(BaseModel):
    """Which camera, and how it is set when connected."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    device: str = Field(description="its path; one of /dev/v4l/by-id stays the same over reboots and other cameras")
    width_px: int = Field(default=1280, ge=8, le=100_000, description="columns of the image")
    height_px: int = Field(default=1024, ge=8, le=100_000, description="rows of the image")
    pixel_format: FourCC = Field(
        default="GREY", description="V4L2's four letters; the luma of YUYV and MJPG is used (MJPG: compressed)"
    )
    exposure_s: Positive = Field(default=0.02, description="exposure when connected, s")
    gain_db: Finite = Field(default=0.0, description="gain when connected, dB")
    frame_rate_hz: Positive = Field(default=11.0, description="frame rate, Hz; it runs from connect() on")
    exposure_limits_s: tuple[Positive, Positive] = Field(
        default=(1e-4, 1.0), description="range of the exposure, s (`v4l2-ctl -L`, in steps of 100 us)"
    )
    gain_limits_db: tuple[Finite, Finite] = Field(default=(0.0, 24.0), description="range of the gain, dB")
    gain_step_db: Positive = Field(default=0.1, description="dB of one step of the gain control; see the data sheet")
    frame_rate_limits_hz: tuple[Positive, Positive] = Field(default=(1.0, 120.0), description="range of rates, Hz")
    pixel_size_mm: Positive = Field(description="edge of a sensor pixel, mm; V4L2 does not tell")
    time_stamp_at: Literal["start", "middle", "end"] = Field(
        default="end", description="what of an exposure the driver's time stamp tells"
    )
    buffer_frames: int = Field(
        default=16, ge=1, le=1024, description="frames held for a late reader; further ones are lost"
    )
    stall_timeout_s: Positive = Field(default=3.0, description="without a frame for so long it counts as lost, s")
    reconnect_s: tuple[Positive, Positive] = Field(
        default=(0.5, 10.0), description="first and longest pause between attempts to open a lost camera again, s"
    )

    @model_validator(mode="after")
    def _possible(self) -> V4l2Options:
        for name, (low, high), value in (
            ("exposure_s", self.exposure_limits_s, self.exposure_s),
            ("gain_db", self.gain_limits_db, self.gain_db),
            ("frame_rate_hz", self.frame_rate_limits_hz, self.frame_rate_hz),
        ):
            if not low <= value <= high:
                raise ValueError(f"{name} = {value:g} must lie in its limits {low:g} to {high:g}")
        if self.exposure_s * self.frame_rate_hz > 1.0:
            raise ValueError(f"an exposure_s of {self.exposure_s:g} does not fit {self.frame_rate_hz:g} Hz; lower one")
        if self.reconnect_s[0] > self.reconnect_s[1]:
            raise ValueError("reconnect_s is the first pause, then the longest one")
        return self
