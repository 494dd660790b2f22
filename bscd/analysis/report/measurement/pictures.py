"""The measuring part's figures, each with what to look for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bscd.analysis.figures import (
    Deviations,
    InflationCurves,
    MapRow,
    draw_inflation_curves,
    draw_map_rows,
    draw_own_scales,
    draw_sphere_beside,
    draw_sphere_maps,
)
from bscd.analysis.report.measurement.data import InflationData, InflationMap, MeasurementData, Shape, SphereData
from bscd.analysis.report.picture import Picture
from bscd.analysis.report.rounding import number
from bscd.arrays import FloatArray

_APART = " Ringed points lie outside the calibrated hull; they were extrapolated on request and count nowhere."


def measurement_pictures(data: MeasurementData) -> Iterator[Picture]:
    """Draw them one by one."""
    if data.sphere is not None:
        yield from _sphere_pictures(data.sphere)
    if data.inflation is not None:
        yield from _inflation_pictures(data.inflation)


def deviations(shape: Shape | None) -> Deviations | None:
    """A shape's radial deviations from the sphere of the nominal radius, or of its own; None without a sphere."""
    if shape is None or shape.fit is None:
        return None
    fit = shape.fit
    away = shape.xyz_mm - fit.centre_mm
    normal = away / np.linalg.norm(away, axis=1, keepdims=True)
    return Deviations(
        name=shape.name[:1].upper() + shape.name[1:],
        places_mm=shape.xyz_mm[:, [0, 2]],
        deviation_mm=np.where(shape.valid, fit.deviation_mm, np.nan),
        mean_mm=shape.deviation(fit).mean_mm,
        std_mm=shape.deviation(fit).std_mm,
        extrapolated=shape.extrapolated,
        sigma_mm=np.where(shape.valid, np.sqrt(np.sum((normal * shape.sigma_mm) ** 2, axis=1)), np.nan),
    )


def _sphere_pictures(sphere: SphereData) -> Iterator[Picture]:
    apart = _APART if any(shape.extrapolated.any() for shape in sphere.shapes) else ""
    before, after, standard = (deviations(shape) for shape in (sphere.before, sphere.after, sphere.standard))
    about = "the sphere of the nominal radius" if sphere.radius_mm is not None else "the best-fit sphere"
    if before is not None or after is not None:
        yield Picture(
            "sphere_deviation",
            "Radial deviation of the sphere (the paper's figure 7)",
            f"Distance of each measured point from {about}, fitted to the points, as the camera sees it; red is "
            "outside, blue inside. Before the correction the deviation follows the prism's distortion; after it, on "
            f"its own scale, only noise without a pattern should be left.{apart}",
            draw_sphere_maps(before, after),
        )
    if after is not None and standard is not None:
        yield Picture(
            "sphere_beside_standard",
            "The biprism beside the standard stereo pair",
            "The same sphere by one camera through the biprism and by two cameras without it, on one scale; both end "
            "at the calibrated hull. The biprism shares one sensor between its views and has a smaller stereo angle, "
            "so its depth is noisier. The pair's lenses are corrected by its own adjustment. The lines "
            "are the normal distribution of the uncertainty that bscd states for each; bars that "
            f"are wider than their line mean that the stated sigma is too small.{apart}",
            draw_sphere_beside(after, standard),
        )
    noisy = sphere.after or sphere.standard
    if noisy is not None and np.isfinite(noisy.sigma_mm).any():
        x, y, z = 1e3 * np.where(noisy.valid[:, None], noisy.sigma_mm, np.nan).T
        panels = [("Sigma of x", "µm", x), ("Sigma of y (depth)", "µm", y), ("Sigma of z", "µm", z)]
        yield Picture(
            "sphere_sigma",
            f"Stated uncertainty and epipolar residual ({noisy.name})",
            "One standard deviation of each coordinate, and by how far each match misses its epipolar line. Sigma "
            "grows where the surface leans away and where the speckles are poor; the residual should be small and "
            "without a pattern, else camera or biprism have moved since the calibration.",
            draw_own_scales(
                noisy.xyz_mm[:, [0, 2]],
                [*panels, ("Epipolar residual", "0.001 px", 1e3 * np.where(noisy.valid, noisy.epipolar_px, np.nan))],
                noisy.extrapolated,
                names=("x (mm)", "z (mm)"),
            ),
        )


def _inflation_pictures(data: InflationData) -> Iterator[Picture]:
    heads, marks = [_head(one) for one in data.maps], [one.extrapolated for one in data.maps]
    apart = _APART if any(mark.any() for mark in marks) else ""
    rows = [
        MapRow(name, "mm", np.stack([one.uvw_mm[:, axis] for one in data.maps]), signed)
        for axis, (name, signed) in enumerate((("u", True), ("v", True), ("w", False)))
    ]
    yield Picture(
        "inflation_displacement",
        "Displacement of the membrane (the paper's figure 8)",
        "u, v and w along x', y', z' of the membrane frame (z' outward, the origin in the middle of the window), at "
        "several pressures, over the points' places in the reference; lines join equal values. On an even membrane u "
        "is zero on the vertical axis, v on the horizontal one, and w is round with its largest value in the middle; "
        f"anything lopsided says that the membrane, its clamp or its thickness is uneven.{apart}",
        draw_map_rows(data.places_mm, rows, heads, marks),
    )
    series = data.series
    yield Picture(
        "inflation_curves",
        "Rise and strain against the pressure",
        "w and the first principal strain of every frame, in the middle of the membrane (mean of the points about the "
        "origin) and the largest of all points. The curves should be smooth; a step is a slip of the clamp, a lost "
        "match or a frame that is missing. Right: the pressure over time, and how many of the points were measured.",
        draw_inflation_curves(
            InflationCurves(
                series.time_s,
                series.pressure_kpa,
                series.w_apex_mm,
                series.w_max_mm,
                series.e1_middle,
                series.e1_max,
                series.valid / max(len(data.places_mm), 1),
            )
        ),
    )
    strained = [one for one in data.maps if np.isfinite(one.principal).any()]
    if strained:
        yield Picture(
            "inflation_strain",
            "Principal strains",
            "Green-Lagrange strains e1 (the larger) and e2 on the surface, each point from the virtual strain gauge "
            "around it, so that the outermost points have none. In the middle of an even membrane both are equal; "
            "towards the clamp e2 falls, since the clamp holds the membrane along its rim.",
            draw_map_rows(
                data.places_mm,
                [
                    MapRow(
                        name, "%", np.stack([100.0 * one.principal[:, axis] for one in strained]), contours=axis == 1
                    )
                    for axis, name in enumerate(("e1", "e2"))
                ],
                [_head(one) for one in strained],
                [np.zeros_like(one.valid) for one in strained],
            ),
        )
    shown = data.shown
    x, y, z = 1e3 * np.where(shown.valid[:, None], shown.sigma_mm, np.nan).T
    yield Picture(
        "inflation_sigma",
        f"Stated uncertainty of the displacement and epipolar residual, {_head(shown)}",
        "One standard deviation of the displacement along the world's x, y (depth) and z, and by how far each point "
        "misses its epipolar line. Depth is several times less sure than the other two, as the stereo angle has it. A "
        "residual with a pattern that grows with the pressure says that left and right drift apart.",
        draw_own_scales(
            data.places_mm,
            [
                ("Sigma along x", "µm", x),
                ("Sigma along y (depth)", "µm", y),
                ("Sigma along z", "µm", z),
                ("Epipolar residual", "0.001 px", 1e3 * np.where(shown.valid, shown.epipolar_px, np.nan)),
            ],
            shown.extrapolated,
        ),
    )
    if data.noise is not None:
        yield Picture(
            "inflation_noise",
            "Noise at rest, point by point",
            f"Standard deviation over time of u, v and w, from {data.noise.basis}. What is larger than its "
            "surroundings has poor speckles, little light, or moved.",
            draw_own_scales(
                data.places_mm,
                [(name, "µm", values) for name, values in zip("uvw", _per_point(data), strict=True)],
                np.zeros(len(data.places_mm), bool),
            ),
        )


def _per_point(data: InflationData) -> FloatArray:
    """Temporal standard deviations ``(3, N)``, µm."""
    return np.full((3, len(data.places_mm)), np.nan) if data.noise is None else 1e3 * data.noise.floor.point_std.T


def _head(one: InflationMap) -> str:
    return f"{number(one.pressure_kpa)} kPa" if np.isfinite(one.pressure_kpa) else f"frame {one.number}"
