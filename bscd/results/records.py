"""What a results file keeps: where its numbers come from, and a frame's shape, displacement and strain."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import BoolArray, FloatArray
from bscd.version import __version__

StereoSource = Literal["biprism", "standard"]
"""The pair of views that was matched: the two halves of one frame, or the primary and the auxiliary camera."""

ParameterValue = str | bool | int | float

#: The status code of a point that was measured; every other code is a reason why a point was not.
VALID = 0


@dataclass(frozen=True, slots=True)
class Origin:
    """A file that results come from; ``uuid`` and ``checksum`` are empty where it has none."""

    file_name: str
    uuid: str
    checksum: str


@dataclass(frozen=True, slots=True, eq=False)
class MembraneFrame:
    """The membrane frame in the world frame: its origin ``(3,)`` in mm, and x', y', z' as the rows of ``axes``."""

    origin_mm: FloatArray
    axes: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ResultsHeader:
    """What describes results as a whole; fixed when the file is made.

    Parameters
    ----------
    title
        What was measured, in words.
    run, calibration
        The run that was measured, and with which calibration.
    points_px
        The requested points ``(N, 2)`` in the reference frame's left view.
    status_names
        What each status code means; `VALID` is among them.
    stereo
        The pair of views.
    reference_frames
        Numbers of the frames whose mean is the reference.
    membrane
        The frame in which u, v, w and strains are given; None where there is none.
    parameters
        Everything that was chosen for the measurement, by name.
    uuid, start_time
        The file's own, the time in ISO 8601, UTC; where they are empty the writer sets them.
    program_version
        The version of bscd that measured.
    """

    title: str
    run: Origin
    calibration: Origin
    points_px: FloatArray
    status_names: Mapping[int, str]
    stereo: StereoSource = "biprism"
    reference_frames: tuple[int, ...] = ()
    membrane: MembraneFrame | None = None
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)
    uuid: str = ""
    start_time: str = ""
    program_version: str = __version__

    def parameters_json(self) -> str:
        """The parameters as strict JSON, which knows no NaN and no infinity: they become null."""

        def strict(value: ParameterValue) -> ParameterValue | None:
            return None if isinstance(value, float) and not math.isfinite(value) else value

        return json.dumps({name: strict(value) for name, value in self.parameters.items()}, indent=1, allow_nan=False)


@dataclass(frozen=True, slots=True, eq=False)
class FrameResult:
    """One frame as measured, a row a requested point; NaN where something is not known.

    Read from a file, ``strain``, ``principal``, ``principal_direction``, ``sigma_mm``, ``displacement_sigma_mm``,
    ``zncc`` and ``epipolar_px`` are float32, the rest float64.

    Parameters
    ----------
    number
        The frame's number as recorded, from 0.
    time_s, pressure_kpa
        When it was taken, and the gauge pressure then.
    xyz_mm, displacement_mm
        Position and displacement since the reference ``(N, 3)``, world frame.
    uvw_mm
        The displacement ``(N, 3)`` along x', y', z' of the membrane frame.
    strain
        Green-Lagrange strains exx, eyy, exy ``(N, 3)`` on the surface, in the membrane frame.
    principal
        Principal strains e1 >= e2 ``(N, 2)``.
    principal_direction
        Direction of e1 on the reference surface ``(N, 3)``, a unit vector in the world frame; its sign means nothing.
    sigma_mm
        One-sigma uncertainty of the position ``(N, 3)``.
    displacement_sigma_mm
        One-sigma uncertainty of the displacement ``(N, 3)``, along the world's axes; what both positions share has
        cancelled, so it is smaller than that of a position.
    zncc, epipolar_px
        Correlation of the match and its distance from the epipolar line ``(N,)``.
    status
        `VALID` or the reason's code ``(N,)`` uint8.
    left_px, right_px
        Where the point is in the two views ``(N, 2)``.
    """

    number: int
    time_s: float
    pressure_kpa: float
    xyz_mm: FloatArray
    displacement_mm: FloatArray
    uvw_mm: FloatArray
    strain: FloatArray
    principal: FloatArray
    principal_direction: FloatArray
    sigma_mm: FloatArray
    displacement_sigma_mm: FloatArray
    zncc: FloatArray
    epipolar_px: FloatArray
    status: NDArray[np.uint8]
    left_px: FloatArray
    right_px: FloatArray

    @classmethod
    def unknown(
        cls, number: int, points: int, status: int, *, time_s: float = math.nan, pressure_kpa: float = math.nan
    ) -> FrameResult:
        """A frame of which nothing is known, for one reason; `dataclasses.replace` fills in what is."""

        def empty(*widths: int) -> FloatArray:
            return np.full((points, *widths), np.nan)

        return cls(
            number=number,
            time_s=time_s,
            pressure_kpa=pressure_kpa,
            xyz_mm=empty(3),
            displacement_mm=empty(3),
            uvw_mm=empty(3),
            strain=empty(3),
            principal=empty(2),
            principal_direction=empty(3),
            sigma_mm=empty(3),
            displacement_sigma_mm=empty(3),
            zncc=empty(),
            epipolar_px=empty(),
            status=np.full(points, status, np.uint8),
            left_px=empty(2),
            right_px=empty(2),
        )

    @property
    def valid(self) -> BoolArray:
        """Which points were measured ``(N,)``."""
        return self.status == VALID

    @property
    def extrapolated(self) -> BoolArray:
        """Which points have a position although they are not valid: outside the calibrated hull ``(N,)``."""
        return ~self.valid & np.isfinite(self.xyz_mm).all(axis=1)
