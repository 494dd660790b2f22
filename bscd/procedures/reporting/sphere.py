"""A measured sphere as a report tells it: before and after the correction, and by the standard pair."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay

from bscd.analysis.report.measurement import Shape, SphereData
from bscd.analysis.surface import SphereFit, fit_sphere
from bscd.analysis.surface.spacing import point_spacing, spread_over_area, surface_scale
from bscd.arrays import BoolArray, FloatArray
from bscd.errors import InputError
from bscd.procedures.reporting.source import Source, known
from bscd.procedures.reporting.views import stereo_angle_deg, view_matrices
from bscd.results import FrameResult, count_points

BEFORE, AFTER, STANDARD = "biprism, before correction", "biprism, after correction", "standard pair"

#: A triangle between points counts as surface while its edges are this many point spacings at most.
_LONGEST_EDGE = 1.6


def sphere_data(biprism: Source | None, standard: Source | None, radius_mm: float | None) -> SphereData | None:
    """The sphere of one or both results; None where there is neither.

    The frame shown is the first that is not the reference, which has no match of its own, where there is one.
    """
    before = after = second = None
    angles: dict[str, float] = {}
    scales: dict[str, float] = {}
    number = 0
    if biprism is not None:
        frame = _frame(biprism)
        number = frame.number
        corrected = bool(biprism.results.header.parameters["corrected"])
        other_mm = _reconstructed(biprism, frame, not corrected)
        unknown = np.full_like(frame.sigma_mm, np.nan)
        own, other = (frame.xyz_mm, frame.sigma_mm), (other_mm, unknown)
        before = _shape(BEFORE, biprism, frame, *(other if corrected else own), radius_mm)
        after = _shape(AFTER, biprism, frame, *(own if corrected else other), radius_mm)
        for shape in (before, after):
            angles[shape.name], scales[shape.name] = _angle_and_scale(biprism, shape)
    if standard is not None:
        frame = _frame(standard)
        number = number if biprism is not None else frame.number
        second = _shape(STANDARD, standard, frame, frame.xyz_mm, frame.sigma_mm, radius_mm)
        angles[STANDARD], scales[STANDARD] = _angle_and_scale(standard, second)
    if before is None and second is None:
        return None
    return SphereData(before, after, second, radius_mm, number, angles, scales)


def surface_area_mm2(points_px: FloatArray, xyz_mm: FloatArray) -> float:
    """Area of the surface between points ``(N, 2)`` px at ``(N, 3)`` mm; holes and what is beyond them not counted."""
    there = np.isfinite(xyz_mm).all(axis=1)
    if not spread_over_area(points_px[there]):
        return 0.0
    corners = Delaunay(points_px[there]).simplices
    edges = np.linalg.norm(points_px[there][corners] - points_px[there][np.roll(corners, 1, axis=1)], axis=2)
    spans = xyz_mm[there][corners]
    areas = np.linalg.norm(np.cross(spans[:, 1] - spans[:, 0], spans[:, 2] - spans[:, 0]), axis=1) / 2.0
    return float(areas[edges.max(axis=1) <= _LONGEST_EDGE * point_spacing(points_px)].sum())


def counts_in_words(source: Source, frame: FrameResult) -> dict[str, int]:
    """How many points of a frame are valid, extrapolated, or lost for which reason."""
    counts, names = count_points([frame]), source.results.header.status_names
    lost = {names.get(code, f"code {code}").replace("_", " "): count for code, count in sorted(counts.lost.items())}
    return {"valid": counts.valid, "extrapolated": counts.extrapolated} | lost


def _frame(source: Source) -> FrameResult:
    """The frame that is shown."""
    reference = source.results.header.reference_frames
    numbers = source.results.frame_numbers()
    others = np.flatnonzero(~np.isin(numbers, reference))
    return source.results.frame(int(others[0]) if len(others) else 0)


def _reconstructed(source: Source, frame: FrameResult, corrected: bool) -> FloatArray:
    """The frame's own pixels, reconstructed with or without the correction ``(N, 3)``."""
    out = np.full_like(frame.xyz_mm, np.nan)
    there = np.isfinite(frame.left_px).all(axis=1) & np.isfinite(frame.right_px).all(axis=1)
    there &= frame.valid | frame.extrapolated
    out[there] = source.calibration.reconstruct(frame.left_px[there], frame.right_px[there], corrected).xyz_mm
    return out


def _shape(
    name: str, source: Source, frame: FrameResult, xyz_mm: FloatArray, sigma_mm: FloatArray, radius_mm: float | None
) -> Shape:
    valid = frame.valid & np.isfinite(xyz_mm).all(axis=1)
    return Shape(
        name=name,
        xyz_mm=xyz_mm,
        sigma_mm=sigma_mm,
        epipolar_px=frame.epipolar_px,
        valid=valid,
        extrapolated=frame.extrapolated,
        fixed=None if radius_mm is None else _fitted(xyz_mm, valid, radius_mm),
        free=_fitted(xyz_mm, valid, None),
        counts=counts_in_words(source, frame),
        area_mm2=surface_area_mm2(source.results.points_px, known(xyz_mm, valid)),
    )


def _fitted(xyz_mm: FloatArray, valid: BoolArray, radius_mm: float | None) -> SphereFit | None:
    """The sphere of the valid points; deviations of all of them. None where the points show none."""
    try:
        return fit_sphere(known(xyz_mm, valid), radius_mm=radius_mm)
    except InputError:
        return None


def _angle_and_scale(source: Source, shape: Shape) -> tuple[float, float]:
    at, points = shape.xyz_mm[shape.valid], source.results.points_px[shape.valid]
    if not spread_over_area(points):
        return float("nan"), float("nan")
    matrices = view_matrices(source.calibration, source.results.header.stereo)
    return stereo_angle_deg(matrices, at.mean(axis=0)), surface_scale(points, at)
