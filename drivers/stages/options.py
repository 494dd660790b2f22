"""What every stage can be told, validated; lengths are in the stage's unit, "mm" or "deg"."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field


def _ordered(interval: tuple[float, float]) -> tuple[float, float]:
    if interval[0] >= interval[1]:
        raise ValueError(f"the limits {interval[0]:g}, {interval[1]:g} must be low, then high")
    return interval


def _port(address: str) -> str:
    if address.startswith("tcp://"):
        number = re.fullmatch(r"tcp://(?:[^\s:/]+|\[[0-9a-fA-F:]+\]):(\d{1,5})", address)
        if not number or not 1 <= int(number[1]) <= 65535:
            raise ValueError(f"{address!r} must be tcp://HOST:PORT")
    elif not address.startswith("/"):
        raise ValueError(f"{address!r} must be the path of a port, /dev/serial/by-id/..., or tcp://HOST:PORT")
    return address


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Interval = Annotated[tuple[Finite, Finite], AfterValidator(_ordered)]
PortAddress = Annotated[str, AfterValidator(_port)]


class StageOptions(BaseModel):
    """What stages of all makers share."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    port: PortAddress = Field(description="serial port, /dev/serial/by-id/..., or tcp://HOST:PORT")
    unit: Literal["mm", "deg"] = Field(description="unit of this axis: mm for a translation, deg for a rotation")
    limits: Interval = Field(description="range of positions that may be asked for, unit")
    reversed: bool = Field(default=False, description="true: the motor's positive sense is the axis's negative one")
    speed: Positive = Field(description="speed of moves, unit/s")
    acceleration: Positive = Field(description="acceleration and deceleration of moves, unit/s^2")
    repeatability: NotNegative = Field(
        default=0.0, description="one sigma of the true position about the reading, unit; 0 when not known"
    )
    tolerance: NotNegative = Field(
        default=0.0, description="how far from its target a move may end, unit; 0 without an encoder"
    )
    serial_number: str = Field(default="", description="refuse a device of another serial number; empty: take any")
    model: str = Field(default="", description="the stage, for reports; empty: what the controller tells")
    answer_timeout_s: Positive = Field(default=0.5, description="how long a command waits for its answer, s")
    timeout_factor: float = Field(
        default=1.5, ge=1.0, le=100.0, description="a move's time-out over its computed duration"
    )
    timeout_margin_s: Positive = Field(default=2.0, description="added to a move's time-out, s")
