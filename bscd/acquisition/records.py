"""What a run file keeps: a frame with everything that was known when it was taken, cameras, axes, events."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bscd.acquisition.names import AxisName, AxisUnit, CameraName, PhaseName
from bscd.hdf5 import FileState
from drivers.interfaces import CameraInfo, FrameStatus, Range

#: Where a run file is in its life; with one that is interrupted `RunWriter.reopen` can go on.
RunState = FileState


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """One frame and where everything stood; NaN (``target_position``: None) where a quantity does not apply.

    ``data`` is ``(height, width)`` uint8 or uint16. ``target_position`` is k of POS.k, ``y_mm`` the displacement
    from POS.0 as read back, ``rotation_deg`` and ``jack_mm`` the readings of their axes, ``time_s`` the time
    since the start of an inflation. ``frame_id`` counts up by one per exposure of its camera;
    ``camera_time_ns`` and ``host_time_ns`` are as in `drivers.interfaces.Frame`.
    """

    camera: CameraName
    phase: PhaseName
    data: NDArray[np.uint8] | NDArray[np.uint16]
    frame_id: int
    camera_time_ns: int = 0
    host_time_ns: int = 0
    status: FrameStatus = FrameStatus.OK
    target_position: int | None = None
    y_mm: float = math.nan
    rotation_deg: float = math.nan
    jack_mm: float = math.nan
    pressure_kpa: float = math.nan
    exposure_s: float = math.nan
    gain_db: float = math.nan
    time_s: float = math.nan


@dataclass(frozen=True, slots=True)
class CameraMeta:
    """A camera as a run file describes it; ``pixel_size_mm`` NaN and texts empty where they are not known."""

    width_px: int
    height_px: int
    bit_depth: int = 8
    pixel_size_mm: float = math.nan
    vendor: str = ""
    model: str = ""
    serial: str = ""

    @classmethod
    def from_info(cls, info: CameraInfo) -> CameraMeta:
        """The part of a driver's `CameraInfo` that a run file keeps."""
        return cls(
            width_px=info.width_px,
            height_px=info.height_px,
            bit_depth=info.bit_depth,
            pixel_size_mm=info.pixel_size_mm,
            vendor=info.vendor,
            model=info.model,
            serial=info.serial,
        )

    @property
    def dtype(self) -> np.dtype[np.uint8] | np.dtype[np.uint16]:
        """The pixels' type: uint8 up to 8 bits, else uint16."""
        return np.dtype(np.uint8) if self.bit_depth <= 8 else np.dtype(np.uint16)


@dataclass(frozen=True, slots=True)
class AxisMeta:
    """An axis as a run file describes it; every value in its ``unit``, NaN or None where it is not known.

    ``origin`` is the axis's reading where the recorded quantity is zero (for the translation stage the reading
    at POS.0, since frames record ``y_mm``); ``tolerance`` how far from its target it may come to rest.
    """

    unit: AxisUnit
    origin: float = 0.0
    limits: Range | None = None
    tolerance: float = math.nan
    vendor: str = ""
    model: str = ""
    serial: str = ""


@dataclass(frozen=True, slots=True)
class PressureMeta:
    """A pressure source as a run file describes it; NaN, None and empty where it is not known."""

    limits_kpa: Range | None = None
    noise_kpa: float = math.nan
    vendor: str = ""
    model: str = ""
    serial: str = ""


@dataclass(frozen=True, slots=True)
class TimeBase:
    """How a camera's clock and the host's belong together.

    ``offset_ns`` added to ``camera_time_ns`` gives the host's time at mid-exposure; ``uncertainty_s`` bounds its error.
    """

    offset_ns: int
    uncertainty_s: float


@dataclass(frozen=True, slots=True)
class RunHeader:
    """What describes a run as a whole; fixed when the file is made. ``start_time`` is ISO 8601, UTC."""

    title: str
    cameras: Mapping[CameraName, CameraMeta]
    config_text: str = ""
    recipe_text: str = ""
    axes: Mapping[AxisName, AxisMeta] = field(default_factory=dict)
    pressure: PressureMeta | None = None
    uuid: str = ""
    start_time: str = ""
    program_version: str = ""


@dataclass(frozen=True, slots=True)
class FrameLoss:
    """Exposures of a stream that are not in its file: ``count`` from number ``first`` (from 0) on, and why."""

    first: int
    count: int
    reason: str


@dataclass(frozen=True, slots=True)
class RunEvent:
    """Something worth knowing that happened during a run, and when (ISO 8601, UTC)."""

    time: str
    text: str
