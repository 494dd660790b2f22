"""What the Aravis driver can be told, validated."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Pixels = Annotated[int, Field(ge=0, le=100_000)]

PixelFormat = Literal["Mono8", "Mono10", "Mono10Packed", "Mono10p", "Mono12", "Mono12Packed", "Mono12p"]


class AravisOptions(BaseModel):
    """Which camera, and how it is set when connected."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    serial: str = Field(default="", description="serial number; empty: the address counts, or the only camera there is")
    address: str = Field(default="", description="IP address or host name of a GigE camera; empty: it is searched for")
    exposure_s: Positive = Field(default=0.02, description="exposure when connected, s")
    gain_db: float = Field(default=0.0, allow_inf_nan=False, description="gain when connected, dB")
    frame_rate_hz: Positive = Field(default=11.0, description="frame rate of a stream when connected, Hz")
    pixel_format: PixelFormat = Field(default="Mono8", description="GenICam name of the pixel format")
    region_px: tuple[Pixels, Pixels, Pixels, Pixels] | None = Field(
        default=None, description="part of the sensor: left, top, width, height in binned pixels; none: all of it"
    )
    binning: tuple[Annotated[int, Field(ge=1, le=16)], Annotated[int, Field(ge=1, le=16)]] = Field(
        default=(1, 1), description="sensor pixels a pixel, across and down"
    )
    pixel_size_mm: Positive | None = Field(
        default=None, description="edge of a sensor pixel, mm; none: as the camera tells"
    )
    trigger: Literal["off", "software", "hardware"] = Field(
        default="off", description="what starts an exposure of a stream: the frame rate, trigger(), or a line"
    )
    trigger_source: str = Field(default="Line1", description="GenICam name of the line of a hardware trigger")
    trigger_edge: Literal["rising", "falling"] = Field(default="rising", description="edge of a hardware trigger")
    time_stamp_at: Literal["start", "middle", "end"] = Field(
        default="start", description="what of an exposure the camera's time stamp tells; see its manual"
    )
    packet_size_bytes: int | None = Field(
        default=None, ge=576, le=16_000, description="GigE packet size; none: what camera and network agree on"
    )
    packet_delay_us: float = Field(default=0.0, ge=0, le=1000, description="GigE pause between two packets, us")
    packet_socket: bool | None = Field(
        default=None, description="receive with a packet socket (needs CAP_NET_RAW); none: yes, but not on loopback"
    )
    packet_resend: bool = Field(default=True, description="ask for lost packets again")
    socket_buffer_bytes: int = Field(
        default=4 << 20, ge=65_536, le=1 << 30, description="receive buffer; the kernel allows net.core.rmem_max"
    )
    stream_buffers: int = Field(default=16, ge=2, le=1024, description="frames that the network thread can fill ahead")
    buffer_frames: int = Field(
        default=16, ge=1, le=1024, description="frames held for a late reader; further ones are lost"
    )
    incomplete_frames: Literal["count", "deliver"] = Field(
        default="count", description="frames with lost packets: counted as lost, or delivered and marked incomplete"
    )
    open_timeout_s: Positive = Field(default=5.0, description="how long connect() waits for another program to let go")
    stall_timeout_s: Positive = Field(default=2.0, description="a stream without a frame for so long is looked into, s")
    reconnect_s: tuple[Positive, Positive] = Field(
        default=(0.5, 10.0), description="first and longest pause between attempts to find a lost camera again, s"
    )

    @model_validator(mode="after")
    def _possible(self) -> AravisOptions:
        if self.serial and self.address:
            raise ValueError("give the serial or the address, not both")
        if self.trigger == "off" and self.exposure_s * self.frame_rate_hz > 1.0:
            raise ValueError(f"an exposure_s of {self.exposure_s:g} does not fit {self.frame_rate_hz:g} Hz; lower one")
        if self.region_px is not None and min(self.region_px[2:]) < 1:
            raise ValueError("region_px is left, top, width, height; width and height must be above 0")
        if self.reconnect_s[0] > self.reconnect_s[1]:
            raise ValueError("reconnect_s is the first pause, then the longest one")
        return self
