"""Measure a run: DIC and 3D for every frame, kept in a results file or handed on."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from bscd.acquisition import FrameRecord, RunFile
from bscd.analysis.surface import MembraneFrame as FittedFrame
from bscd.analysis.surface import StrainGauge, StrainSettings
from bscd.arrays import FloatArray
from bscd.calibration import Calibration
from bscd.dic import estimate_noise
from bscd.errors import InputError
from bscd.procedures.measuring.frames import FrameChoice, choose_frames, frame_records
from bscd.procedures.measuring.geometry import BiprismGeometry, StandardGeometry
from bscd.procedures.measuring.overlap import one_ahead, plain_linear_algebra
from bscd.procedures.measuring.region import covered_mask, requested_points
from bscd.procedures.measuring.sequence import Measured, PointStatus, Sequence
from bscd.procedures.measuring.settings import MeasureSettings
from bscd.procedures.measuring.views import BiprismSplitter, FrameViews, pair_views
from bscd.procedures.progress import Progress, ProgressCallback
from bscd.results import FrameResult, MembraneFrame, Origin, ResultsHeader, ResultsWriter

#: A point's epipolar residual above this many times the calibration's limit for a frame is refused.
_EPIPOLAR_TIMES = 5.0

#: Noise of rounding to whole grey levels.
_ROUNDING_GREY = math.sqrt(1.0 / 12.0)

#: So many points must be known for the membrane's frame and strains.
_LEAST_POINTS = 30


@dataclass(frozen=True, eq=False)
class Measurement:
    """A measurement under way: what describes it, and its frames when their turn comes.

    ``sequence`` holds the reference's match; ``frame`` the membrane frame, None where there is none.
    """

    header: ResultsHeader
    choice: FrameChoice
    sequence: Sequence
    frame: FittedFrame | None
    frames: Iterator[FrameResult]


@plain_linear_algebra()
def measure_run(
    calibration: Calibration,
    run: RunFile,
    settings: MeasureSettings | None = None,
    *,
    calibration_name: str = "",
    progress: ProgressCallback | None = None,
    warn: Callable[[str], None] | None = None,
) -> Measurement:
    """Begin to measure; the frames are read and matched one at a time, so memory does not grow with their number.

    Unless ``threads`` is 1 a frame is read and the next is matched, each on a thread, while one's result is used.

    Raises `InputError` for a calibration, run or settings that do not fit each other. What can not be measured in a
    frame is NaN there with its reason as status.
    """
    settings = settings or MeasureSettings()
    choice = choose_frames(run, settings.phase, settings.stereo, calibration.jack_mm)
    say = warn or (lambda _: None)
    to_views = _splitter(calibration, choice, settings)
    reference, first = _reference(run, choice, to_views)
    single = max(estimate_noise(first).sigma_grey, _ROUNDING_GREY)
    points = requested_points(reference.left, settings.step_px, settings.subset_px, max(single, 0.3), settings.region)
    # shot noise is larger on the lit surface than in the dark around it; few points can not tell
    with suppress(InputError):
        where = covered_mask(first.shape, points, settings.subset_px)
        single = max(estimate_noise(first, mask=where).sigma_grey, _ROUNDING_GREY)
    noise = (single / math.sqrt(len(choice.reference)), single)
    geometry = (
        BiprismGeometry(calibration, settings.corrected, settings.extrapolate)
        if settings.stereo == "biprism"
        else StandardGeometry(calibration)
    )
    limit = settings.epipolar_limit_px or _EPIPOLAR_TIMES * calibration.epipolar_limit_px
    sequence = Sequence(reference, points, geometry, settings, noise, limit)
    if not sequence.reference.valid.any():
        raise InputError(f"{run.path}: {_why_nothing(sequence.reference, limit)}")
    _warn_if_moved(calibration, sequence.reference, settings, say)
    frame = _membrane_frame(sequence.reference, choice, say)
    gauge = _gauge(points, sequence.reference, frame, settings, say)
    header = _header(calibration, calibration_name, run, choice, settings, sequence, frame, noise, gauge)
    return Measurement(
        header,
        choice,
        sequence,
        frame,
        _frames(run, choice, to_views, sequence, frame, gauge, progress, overlap=settings.threads != 1),
    )


def measure_to_file(
    calibration: Calibration,
    run: RunFile,
    path: str | Path,
    settings: MeasureSettings | None = None,
    *,
    calibration_name: str = "",
    progress: ProgressCallback | None = None,
    warn: Callable[[str], None] | None = None,
) -> ResultsHeader:
    """Measure a run into a new results file; what was measured stays readable if it is cut off."""
    if Path(path).exists():
        raise InputError(f"{path}: exists already; results are never overwritten, choose another name")
    measurement = measure_run(
        calibration, run, settings, calibration_name=calibration_name, progress=progress, warn=warn
    )
    with ResultsWriter(path, measurement.header, flush_every=10) as writer:
        for frame in measurement.frames:
            writer.append(frame)
    return measurement.header


ToViews = Callable[[FrameRecord, FrameRecord | None], FrameViews]


def _splitter(calibration: Calibration, choice: FrameChoice, settings: MeasureSettings) -> ToViews:
    if settings.stereo == "standard":

        def pair(primary: FrameRecord, auxiliary: FrameRecord | None) -> FrameViews:
            assert auxiliary is not None  # noqa: S101 - choose_frames pairs them
            return pair_views(primary, auxiliary, settings.subset_px)

        return pair
    splitter = BiprismSplitter(calibration, (choice.size_px[1], choice.size_px[0]), settings.subset_px)
    return lambda primary, _: splitter.views(np.asarray(primary.data, np.float32))


def _reference(run: RunFile, choice: FrameChoice, to_views: ToViews) -> tuple[FrameViews, np.ndarray]:
    """The mean of the reference frames as views, and the first of them as it was taken."""
    taken = list(islice(frame_records(run, choice), len(choice.reference)))

    def mean(frames: list[FrameRecord]) -> FrameRecord:
        stack = np.stack([np.asarray(frame.data, np.float32) for frame in frames])
        return _with_data(frames[0], np.asarray(stack.mean(axis=0)))

    primary = mean([first for first, _ in taken])
    seconds = [second for _, second in taken if second is not None]
    views = to_views(primary, mean(seconds) if seconds else None)
    return views, np.asarray(taken[0][0].data)


def _with_data(record: FrameRecord, data: np.ndarray) -> FrameRecord:
    return FrameRecord(record.camera, record.phase, data, frame_id=record.frame_id)


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


def _warn_if_moved(
    calibration: Calibration, reference: Measured, settings: MeasureSettings, warn: Callable[[str], None]
) -> None:
    residual = float(np.nanmedian(reference.epipolar_px))
    if settings.stereo == "biprism" and settings.corrected and residual > calibration.epipolar_limit_px:
        warn(
            f"the reference's median epipolar residual is {residual:.2f} px (limit {calibration.epipolar_limit_px:g}): "
            f"camera or biprism have moved since the calibration; calibrate again"
        )


def _membrane_frame(reference: Measured, choice: FrameChoice, warn: Callable[[str], None]) -> FittedFrame | None:
    if choice.phase != "inflation":
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


def _frames(
    run: RunFile,
    choice: FrameChoice,
    to_views: ToViews,
    sequence: Sequence,
    frame: FittedFrame | None,
    gauge: StrainGauge | None,
    progress: ProgressCallback | None,
    overlap: bool,
) -> Iterator[FrameResult]:
    read = ((primary, to_views(primary, auxiliary)) for primary, auxiliary in frame_records(run, choice))
    matched = ((primary, sequence.measure(views)) for primary, views in (one_ahead(read) if overlap else read))
    with plain_linear_algebra():
        for number, (primary, measured) in enumerate(one_ahead(matched) if overlap else matched):
            yield _result(number, primary, measured, frame, gauge)
            if progress is not None:
                progress(Progress(number + 1, len(choice), f"{choice.phase} frame {number}"))


def _result(
    number: int, record: FrameRecord, measured: Measured, frame: FittedFrame | None, gauge: StrainGauge | None
) -> FrameResult:
    count = len(measured.status)
    strain, principal, direction = np.full((count, 3), np.nan), np.full((count, 2), np.nan), np.full((count, 3), np.nan)
    if gauge is not None:
        found = gauge.measure(np.where(measured.valid[:, None], measured.xyz_mm, np.nan))
        strain, principal = found.strain, found.principal
        if frame is not None:
            angle = np.radians(found.angle_deg)
            direction = np.column_stack([np.cos(angle), np.sin(angle)]) @ frame.axes[:2]
    uvw = np.full((count, 3), np.nan) if frame is None else frame.vectors(measured.displacement_mm)
    return FrameResult(
        number=number,
        time_s=record.time_s,
        pressure_kpa=record.pressure_kpa,
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


def _header(
    calibration: Calibration,
    calibration_name: str,
    run: RunFile,
    choice: FrameChoice,
    settings: MeasureSettings,
    sequence: Sequence,
    frame: FittedFrame | None,
    noise_grey: tuple[float, float],
    gauge: StrainGauge | None,
) -> ResultsHeader:
    parameters = settings.parameters() | {
        "phase": choice.phase,
        "noise_reference_grey": noise_grey[0],
        "noise_frame_grey": noise_grey[1],
        "triangulation": calibration.choices.triangulation,
        "maps": calibration.choices.interpolant,
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
        title=f"{choice.phase} of {run.title}",
        run=Origin(run.path.name, run.uuid, run.checksum),
        calibration=Origin(calibration_name, "", calibration.checksum),
        points_px=sequence.points_px,
        status_names={int(code): code.name.lower() for code in PointStatus},
        stereo=settings.stereo,
        reference_frames=choice.reference,
        membrane=None if frame is None else MembraneFrame(frame.origin_mm, frame.axes),
        parameters=parameters,
    )
