"""Begin a measurement from its reference: points, stereo match, membrane frame and strain gauge."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from bscd.acquisition import PhaseName
from bscd.analysis.surface import MembraneFrame as FittedFrame
from bscd.analysis.surface import StrainGauge, StrainSettings
from bscd.arrays import FloatArray
from bscd.calibration import Calibration
from bscd.dic import estimate_noise
from bscd.errors import InputError
from bscd.procedures.measuring.epipolar_watch import EpipolarWatch
from bscd.procedures.measuring.geometry import BiprismGeometry, StandardGeometry
from bscd.procedures.measuring.region import covered_mask, requested_points
from bscd.procedures.measuring.sequence import Measured, PointStatus
from bscd.procedures.measuring.sequence import Sequence as MeasuredSequence
from bscd.procedures.measuring.settings import MeasureSettings
from bscd.procedures.measuring.views import BiprismSplitter, FrameImages, ViewSource
from bscd.results import FrameResult, MembraneFrame, Origin, ResultsHeader

#: A point's epipolar residual above this many times the calibration's limit for a frame is refused.
_EPIPOLAR_TIMES = 5.0

#: Noise of rounding to whole grey levels.
_ROUNDING_GREY = math.sqrt(1.0 / 12.0)

#: So many points must be known for the membrane's frame and strains.
_LEAST_POINTS = 30


@dataclass(frozen=True, eq=False)
class Begun:
    """A measurement whose reference is known: all that frames need to become results.

    ``reference`` are the mean images of the frames ``numbers``; ``noise_grey`` is that of the reference and of a frame.
    """

    calibration: Calibration
    settings: MeasureSettings
    phase: PhaseName
    source: ViewSource
    reference: FrameImages
    numbers: tuple[int, ...]
    sequence: MeasuredSequence
    frame: FittedFrame | None
    gauge: StrainGauge | None
    noise_grey: tuple[float, float]
    watch: EpipolarWatch

    def result(self, number: int, time_s: float, pressure_kpa: float, measured: Measured) -> FrameResult:
        """A frame's result, with u, v, w and strains; warns of the first that shows that the rig has moved."""
        self.watch.look(number, measured)
        frame, gauge = self.frame, self.gauge
        count = len(measured.status)
        strain, principal, direction = (
            np.full((count, 3), np.nan),
            np.full((count, 2), np.nan),
            np.full((count, 3), np.nan),
        )
        if gauge is not None:
            found = gauge.measure(np.where(measured.valid[:, None], measured.xyz_mm, np.nan))
            strain, principal = found.strain, found.principal
            if frame is not None:
                angle = np.radians(found.angle_deg)
                direction = np.column_stack([np.cos(angle), np.sin(angle)]) @ frame.axes[:2]
        uvw = np.full((count, 3), np.nan) if frame is None else frame.vectors(measured.displacement_mm)
        return FrameResult(
            number=number,
            time_s=time_s,
            pressure_kpa=pressure_kpa,
            xyz_mm=measured.xyz_mm,
            displacement_mm=measured.displacement_mm,
            uvw_mm=uvw,
            strain=strain,
            principal=principal,
            principal_direction=direction,
            sigma_mm=measured.sigma_mm,
            displacement_sigma_mm=measured.displacement_sigma_mm,
            zncc=measured.zncc,
            epipolar_px=measured.epipolar_px,
            status=measured.status,
            left_px=measured.left_px,
            right_px=measured.right_px,
        )

    def header(self, title: str, run: Origin, calibration_name: str) -> ResultsHeader:
        """What describes the results of a run with a title."""
        settings, sequence, gauge, frame, choices = (
            self.settings,
            self.sequence,
            self.gauge,
            self.frame,
            self.calibration.choices,
        )
        parameters = settings.parameters() | {
            "phase": self.phase,
            "noise_reference_grey": self.noise_grey[0],
            "noise_frame_grey": self.noise_grey[1],
            "triangulation": choices.triangulation,
            "maps": choices.interpolant,
            "epipolar_limit_px": float(self.watch.refused_px),
            "epipolar_median_px": float(np.nanmedian(sequence.reference.epipolar_px)),
        }
        if gauge is not None:
            window = gauge.window
            parameters |= {
                "strain_window_points": window.window_points,
                "vsg_px": float(window.vsg_px),
                "vsg_mm": float(window.vsg_mm),
                "mm_per_px": float(window.mm_per_px),
            }
        return ResultsHeader(
            title=f"{self.phase} of {title}",
            run=run,
            calibration=Origin(calibration_name, "", self.calibration.checksum),
            points_px=sequence.points_px,
            status_names={int(code): code.name.lower() for code in PointStatus},
            stereo=settings.stereo,
            reference_frames=self.numbers,
            membrane=None if frame is None else MembraneFrame(frame.origin_mm, frame.axes),
            parameters=parameters,
        )


def view_source(
    calibration: Calibration,
    size_px: tuple[int, int],
    settings: MeasureSettings,
    auxiliary_size_px: tuple[int, int] | None = None,
) -> ViewSource:
    """What makes views of images of the primary camera of a size (width, height), and of the auxiliary one's if given.

    Raises `InputError` where the calibration is for images of another size.
    """
    for camera, now_px in (("primary", size_px), ("auxiliary", auxiliary_size_px)):
        then_px = calibration.image_size_px[camera]
        if now_px is not None and now_px != then_px:
            raise InputError(
                f"calibration: it is for {then_px[0]} x {then_px[1]} px of the {camera} camera, the run's images are "
                f"{now_px[0]} x {now_px[1]} px; set region (ROI) and binning as when calibrated, or calibrate again"
            )
    if settings.stereo == "standard":
        return ViewSource(None, settings.subset_px)
    return ViewSource(BiprismSplitter.of(calibration, (size_px[1], size_px[0]), settings.subset_px), settings.subset_px)


def begin(
    calibration: Calibration,
    source: ViewSource,
    taken: Sequence[FrameImages],
    phase: PhaseName,
    settings: MeasureSettings,
    *,
    run_name: str,
    warn: Callable[[str], None],
    numbers: Sequence[int] | None = None,
) -> Begun:
    """Match the views of the reference, the mean of the frames ``taken``; raises `InputError` where they do not match.

    ``run_name`` is what messages call the run; ``numbers`` are those of the frames taken (None: the first ones).
    """
    reference = tuple(_mean(images) for images in zip(*taken, strict=True))
    views, first = source.views(reference), taken[0][0]
    single = max(estimate_noise(first).sigma_grey, _ROUNDING_GREY)
    points = requested_points(views.left, settings.step_px, settings.subset_px, max(single, 0.3), settings.region)
    # shot noise is larger on the lit surface than in the dark around it; few points can not tell
    with suppress(InputError):
        where = covered_mask(first.shape, points, settings.subset_px)
        single = max(estimate_noise(first, mask=where).sigma_grey, _ROUNDING_GREY)
    noise = (single / math.sqrt(len(taken)), single)
    geometry = (
        BiprismGeometry(calibration, settings.corrected, settings.extrapolate)
        if settings.stereo == "biprism"
        else StandardGeometry(calibration)
    )
    limit = settings.epipolar_limit_px
    if limit is None:
        limit = _EPIPOLAR_TIMES * calibration.epipolar_limit_px
    sequence = MeasuredSequence(views, points, geometry, settings, noise, limit)
    if not sequence.reference.valid.any():
        raise InputError(f"{run_name}: {_why_nothing(sequence.reference, limit)}")
    biprism = settings.stereo == "biprism"
    watch = EpipolarWatch(
        sequence.reference,
        limit_px=calibration.epipolar_limit_px if settings.corrected or not biprism else None,
        refused_px=limit,
        moved="camera or biprism have" if biprism else "primary or auxiliary camera have",
        warn=warn,
    )
    frame = _membrane_frame(sequence.reference, phase, warn)
    gauge = _gauge(points, sequence.reference, frame, settings, warn)
    return Begun(
        calibration,
        settings,
        phase,
        source,
        reference,
        tuple(range(len(taken)) if numbers is None else numbers),
        sequence,
        frame,
        gauge,
        noise,
        watch,
    )


def _mean(images: Sequence[np.ndarray]) -> np.ndarray:
    return np.asarray(np.stack([np.asarray(image, np.float32) for image in images]).mean(axis=0))


def _why_nothing(reference: Measured, limit_px: float) -> str:
    """Why no point of the reference could be measured."""
    beside = reference.epipolar_px[reference.status == PointStatus.EPIPOLAR]
    if len(beside) > np.count_nonzero(reference.status == PointStatus.OUTSIDE_VOLUME):
        return (
            f"the reference frame's left and right view match, but {np.median(beside):.1f} px (median) beside their "
            f"epipolar lines, limit {limit_px:g}; the calibration is of another rig, or camera or biprism have moved "
            f"since: calibrate again"
        )
    return (
        "the reference frame's left and right view match nowhere inside the calibrated volume; "
        "is the calibration of this rig, and is the object in the volume?"
    )


def _membrane_frame(reference: Measured, phase: PhaseName, warn: Callable[[str], None]) -> FittedFrame | None:
    if phase != "inflation":
        return None
    known = reference.xyz_mm[reference.valid]
    if len(known) < _LEAST_POINTS:
        warn(f"no membrane frame: {len(known)} points of the reference are known, {_LEAST_POINTS} are needed")
        return None
    return FittedFrame.fit(known)


def _gauge(
    points: FloatArray,
    reference: Measured,
    frame: FittedFrame | None,
    settings: MeasureSettings,
    warn: Callable[[str], None],
) -> StrainGauge | None:
    if not settings.strain or frame is None:
        return None
    try:
        chosen = StrainSettings(
            vsg_mm=settings.vsg_mm, subset_px=float(settings.subset_px), step_px=float(settings.step_px)
        )
        return StrainGauge(points, reference.xyz_mm, settings=chosen, frame=frame)
    except InputError as error:
        warn(f"no strains: {error}")
        return None
