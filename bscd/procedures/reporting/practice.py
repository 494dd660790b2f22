"""The reporting table of the iDICs guide, filled in from run, calibration and results.

International Digital Image Correlation Society, "A Good Practices Guide for Digital Image Correlation" (2018),
appendix on reporting requirements. What nothing tells is "not recorded".
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bscd.acquisition import CameraMeta
from bscd.analysis.report.measurement import NOT_RECORDED, PracticeColumn, RestNoise
from bscd.analysis.report.rounding import number
from bscd.analysis.surface import StrainSettings
from bscd.analysis.surface.spacing import spread_over_area, surface_scale
from bscd.arrays import FloatArray
from bscd.dic import estimate_noise
from bscd.dic.speckle_size import speckle_size
from bscd.errors import InputError
from bscd.procedures.reporting.inflation import frame_rate_hz
from bscd.procedures.reporting.source import Source
from bscd.procedures.reporting.views import distance_mm, stereo_angle_deg, view_matrices
from bscd.results import ParameterValue

HARDWARE, ANALYSIS, NOISE = "hardware", "analysis", "noise floor"

Values = dict[tuple[str, str], str]

#: Windows in which the speckles' size is looked at.
_MOST_WINDOWS = 400


def practice_column(
    source: Source, title: str, noise: RestNoise | None, why_no_noise: str, facts: Mapping[str, str]
) -> PracticeColumn:
    """One measurement's column; ``facts`` are parameters that only the configuration or the operator knows."""
    frame = source.results.frame(0)
    valid = frame.valid & np.isfinite(frame.xyz_mm).all(axis=1)
    at, points = frame.xyz_mm[valid], source.results.points_px[valid]
    scale = surface_scale(points, at) if spread_over_area(points) else float("nan")
    values: Values = {}
    values |= _hardware(source, at, points, scale, facts)
    values |= _analysis(source, scale)
    values |= _noise(noise, why_no_noise)
    return PracticeColumn(title, values)


def _hardware(
    source: Source, at_mm: FloatArray, points_px: FloatArray, scale: float, facts: Mapping[str, str]
) -> Values:
    camera, rows = source.run.cameras["primary"], source.rows()
    biprism = source.results.header.stereo == "biprism"
    matrices = view_matrices(source.calibration, source.results.header.stereo)
    middle = at_mm.mean(axis=0) if len(at_mm) else np.full(3, np.nan)
    width_px = camera.width_px / 2 if biprism else camera.width_px
    rate = frame_rate_hz(source.results.array("time_s"))
    found = {
        "Camera": _camera(camera),
        "Pair of views": "both halves of one frame, through a biprism" if biprism else "two cameras",
        "Image resolution": f"{camera.width_px} x {camera.height_px} px, {camera.bit_depth} bit"
        + (f", {width_px:.0f} x {camera.height_px} px a view" if biprism else ""),
        "Pixel size": _with(camera.pixel_size_mm * 1e3, "µm"),
        "Lens": facts.get("lens", ""),
        "Aperture": facts.get("aperture", ""),
        "Field of view": _size(width_px * scale, camera.height_px * scale),
        "Image scale": f"{number(scale, 4)} mm/px ({number(1.0 / scale)} px/mm)" if np.isfinite(scale) else "",
        "Stereo angle": _with(stereo_angle_deg(matrices, middle), "deg") if len(at_mm) else "",
        "Stand-off distance": _with(distance_mm(matrices[0], middle), "mm") if len(at_mm) else "",
        "Frame rate": _with(rate, "frames/s"),
        "Exposure": _spread(rows["exposure_s"] * 1e3, "ms"),
        "Gain": _spread(rows["gain_db"], "dB"),
        "Light": facts.get("light", ""),
        "Pattern technique": facts.get("pattern", ""),
        "Pattern feature size": _feature_size(source, points_px, scale),
    }
    return {(HARDWARE, name): value or NOT_RECORDED for name, value in found.items()}


def _analysis(source: Source, scale: float) -> Values:
    header, calibration = source.results.header, source.calibration
    given = header.parameters
    subset, step = _number(given, "subset_px"), _number(given, "step_px")
    window, vsg_px, vsg_mm = (_number(given, name) for name in ("strain_window_points", "vsg_px", "vsg_mm"))
    strained = np.isfinite(window)
    rate = frame_rate_hz(source.results.array("time_s"))
    orders = StrainSettings()
    reference = header.reference_frames
    found = {
        "Software": f"bscd {header.program_version}",
        "Image prefilter": "none but the B-spline's own",
        "Subset": _px_and_mm(subset, scale),
        "Step": _px_and_mm(step, scale),
        "Interpolation": str(given.get("interpolation", "")),
        "Shape function, stereo match": str(given.get("stereo_shape", "")),
        "Shape function, tracking": str(given.get("tracking_shape", "")),
        "Criterion": ", ".join(str(given[name]) for name in ("criterion", "optimisation") if name in given),
        "Least correlation (ZNCC)": _with(_number(given, "zncc_min"), ""),
        "Calibration": f"{calibration.choices.reference} reference, {calibration.choices.interpolant} maps, "
        f"{calibration.choices.triangulation} triangulation",
        "Points": f"{len(header.points_px)}",
        "Frames averaged for the reference": f"{len(reference)} (numbers {min(reference)} to {max(reference)})"
        if len(reference) > 1
        else f"{len(reference)}",
        "Strain": "Green-Lagrange, on the surface, in the membrane frame" if strained else "none",
        "Strain window": f"{window:.0f} x {window:.0f} points, polynomials of degree {orders.order} along the surface, "
        f"{orders.depth_order} across it"
        if strained
        else "none",
        "Virtual strain gauge": f"{number(vsg_px)} px, {number(vsg_mm)} mm" if strained else "none",
        "Temporal resolution": f"{number(1e3 / rate)} ms between frames" if np.isfinite(rate) else "",
    }
    return {(ANALYSIS, name): value or NOT_RECORDED for name, value in found.items()}


def _noise(noise: RestNoise | None, why: str) -> Values:
    names = ("Taken from", "Displacement u, v, w", "over time", "Strain exx, eyy, exy", "strain over time")
    if noise is None:
        told = f"{NOT_RECORDED}: {why}" if why else NOT_RECORDED
        return {(NOISE, name): told if place == 0 else NOT_RECORDED for place, name in enumerate(names)}
    found = (
        noise.basis,
        _three(1e3 * noise.displacement_mm, "µm"),
        _three(1e3 * noise.temporal_mm, "µm"),
        "" if noise.strain is None else _three(1e6 * noise.strain, "microstrain"),
        "" if noise.temporal_strain is None else _three(1e6 * noise.temporal_strain, "microstrain"),
    )
    return {(NOISE, name): value or NOT_RECORDED for name, value in zip(names, found, strict=True)}


def _camera(camera: CameraMeta) -> str:
    return " ".join(word for word in (camera.vendor, camera.model, camera.serial and f"({camera.serial})") if word)


def _feature_size(source: Source, points_px: FloatArray, scale: float) -> str:
    """The median size of the speckles, measured on the reference's first frame."""
    if not len(points_px):
        return ""
    image = np.asarray(source.reference_record().data)
    some = points_px[:: max(1, len(points_px) // _MOST_WINDOWS)]
    try:
        size = speckle_size(image, some, noise_grey=float(estimate_noise(image).sigma_grey))
    except InputError:
        return ""
    known = size[np.isfinite(size).all(axis=1)]
    return _px_and_mm(float(np.median(known)), scale) + ", measured" if len(known) else ""


def _number(parameters: Mapping[str, ParameterValue], name: str) -> float:
    value = parameters.get(name)
    return float(value) if isinstance(value, int | float) else float("nan")


def _with(value: float, unit: str) -> str:
    return f"{number(value)} {unit}".strip() if np.isfinite(value) else ""


def _size(width: float, height: float) -> str:
    return f"{number(width)} x {number(height)} mm a view" if np.isfinite(width + height) else ""


def _px_and_mm(px: float, scale: float) -> str:
    if not np.isfinite(px):
        return ""
    return f"{px:.3g} px" + (f", {number(px * scale)} mm" if np.isfinite(scale) else "")


def _spread(values: FloatArray, unit: str) -> str:
    """One value, or from the least to the most."""
    values = values[np.isfinite(values)]
    if not values.size:
        return ""
    low, high = float(values.min()), float(values.max())
    return f"{number(low)} {unit}" if low == high else f"{number(low)} to {number(high)} {unit}"


def _three(values: FloatArray, unit: str) -> str:
    return ", ".join(number(float(value), 2) for value in values) + f" {unit}" if np.isfinite(values).any() else ""
