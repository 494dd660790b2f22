"""What the measuring part of a report tells: a sphere, an inflation, and how both were measured, as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bscd.analysis.surface import NoiseFloor, SphereFit
from bscd.analysis.validation import ErrorFigure
from bscd.arrays import BoolArray, FloatArray

NOT_RECORDED = "not recorded"


@dataclass(frozen=True, eq=False)
class Shape:
    """The sphere as one pair of views saw it, a row a requested point, NaN where not known.

    ``xyz_mm``, ``sigma_mm`` ``(N, 3)``; ``epipolar_px`` ``(N,)``; ``valid`` ``(N,)`` are the points that count,
    ``extrapolated`` ``(N,)`` those outside the calibrated hull that were kept on request. ``fixed`` is the sphere of
    the nominal radius (None where that is not known or does not fit), ``free`` that of its own radius. ``counts``: how
    many points are valid, and how many are not for which reason. ``area_mm2`` is the measured surface's.
    """

    name: str
    xyz_mm: FloatArray
    sigma_mm: FloatArray
    epipolar_px: FloatArray
    valid: BoolArray
    extrapolated: BoolArray
    fixed: SphereFit | None
    free: SphereFit | None
    counts: Mapping[str, int]
    area_mm2: float

    @property
    def fit(self) -> SphereFit | None:
        """The sphere that deviations are shown from: of the nominal radius where there is one."""
        return self.fixed or self.free

    def deviation(self, fit: SphereFit, *, outliers: bool = False) -> ErrorFigure:
        """Radial deviations of the valid points that took part in a fit, with ``outliers`` of all valid ones."""
        return ErrorFigure.of(fit.deviation_mm[self.valid if outliers else self.valid & fit.used])


@dataclass(frozen=True, eq=False)
class SphereData:
    """A sphere through the biprism ``before`` and ``after`` the correction, and by the ``standard`` pair.

    ``radius_mm`` is the nominal radius, None where it is not known; ``stereo_angle_deg`` and ``mm_per_px`` by the
    shapes' names.
    """

    before: Shape | None
    after: Shape | None
    standard: Shape | None
    radius_mm: float | None
    frame: int
    stereo_angle_deg: Mapping[str, float] = field(default_factory=dict)
    mm_per_px: Mapping[str, float] = field(default_factory=dict)

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Those there are."""
        return tuple(shape for shape in (self.before, self.after, self.standard) if shape is not None)


@dataclass(frozen=True, eq=False)
class InflationMap:
    """One frame of an inflation, a row a requested point, NaN where not known.

    ``uvw_mm`` ``(N, 3)`` in the membrane frame, ``principal`` ``(N, 2)``, ``sigma_mm`` ``(N, 3)`` of the displacement
    along world x, y, z, ``epipolar_px``, ``valid``, ``extrapolated`` ``(N,)``.
    """

    number: int
    pressure_kpa: float
    uvw_mm: FloatArray
    principal: FloatArray
    sigma_mm: FloatArray
    epipolar_px: FloatArray
    valid: BoolArray
    extrapolated: BoolArray


@dataclass(frozen=True, eq=False)
class InflationSeries:
    """A value a frame ``(T,)``; NaN where not known.

    ``w_apex_mm`` and ``e1_middle`` are means over the points about the membrane frame's origin, ``w_max_mm`` and
    ``e1_max`` the largest of all valid points.
    """

    number: FloatArray
    time_s: FloatArray
    pressure_kpa: FloatArray
    w_apex_mm: FloatArray
    w_max_mm: FloatArray
    e1_middle: FloatArray
    e1_max: FloatArray
    valid: FloatArray


@dataclass(frozen=True, eq=False)
class RestNoise:
    """Noise floors of displacement (u, v, w) and strain (exx, eyy, exy; None without strains) from static frames.

    ``basis`` says in words what they were taken from. ``displacement_mm`` and ``strain`` ``(3,)`` are the spatial
    standard deviations as the iDICs guide asks for them, freed from the reference's noise being shared where
    need be; ``temporal_mm`` and ``temporal_strain`` those over time, of single frames.
    """

    basis: str
    frames: int
    displacement_mm: FloatArray
    temporal_mm: FloatArray
    strain: FloatArray | None
    temporal_strain: FloatArray | None
    floor: NoiseFloor


@dataclass(frozen=True, eq=False)
class InflationData:
    """An inflation: ``places_mm`` ``(N, 2)`` are the points' x', y' in the reference, the maps a few of its frames.

    ``truth_w_rms_mm`` ``(T,)`` is each frame's error of w, known on the twin alone.
    """

    places_mm: FloatArray
    maps: Sequence[InflationMap]
    series: InflationSeries
    noise: RestNoise | None
    why_no_noise: str = ""
    counts: Mapping[str, int] = field(default_factory=dict)
    frames_lost: int = 0
    reference_frames: tuple[int, ...] = ()
    frames_per_s: float = float("nan")
    truth_w_rms_mm: FloatArray | None = None

    @property
    def shown(self) -> InflationMap:
        """The map that the strain and uncertainty figures show: of the highest pressure."""
        known = [one for one in self.maps if np.isfinite(one.pressure_kpa)]
        return max(known, key=lambda one: one.pressure_kpa) if known else self.maps[-1]


@dataclass(frozen=True)
class PracticeColumn:
    """The iDICs reporting table's column of one measurement: (group, parameter) -> value in words."""

    title: str
    values: Mapping[tuple[str, str], str]


@dataclass(frozen=True, eq=False)
class MeasurementData:
    """Everything that the measuring part of a report tells."""

    sphere: SphereData | None
    inflation: InflationData | None
    practice: Sequence[PracticeColumn]
