"""The measuring part's tables: figures beside the paper's, the biprism beside the pair, what was reported how."""

from __future__ import annotations

import numpy as np

from bscd.analysis.figures import Deviations
from bscd.analysis.report.measurement.data import MeasurementData, Shape, SphereData
from bscd.analysis.report.measurement.pictures import deviations
from bscd.analysis.report.rounding import UNKNOWN, mean_and_std, number
from bscd.analysis.report.table import Table
from bscd.analysis.surface import SphereFit


def measured_table(data: MeasurementData) -> Table:
    """What was measured beside the paper's figures."""
    rows: list[tuple[str, str, str]] = []
    sphere, inflation = data.sphere, data.inflation
    if sphere is not None:
        for shape, paper in (
            (sphere.before, "0.32 ± 0.10 mm"),
            (sphere.after, "0.00056 ± 0.08 mm"),
            (sphere.standard, ""),
        ):
            if shape is not None:
                rows.append((f"Sphere, radial deviation, {shape.name}", _deviation(shape, shape.fit), paper))
        main = sphere.after or sphere.standard
        if main is not None:
            rows.append((f"Sphere, radius, {main.name}", _radius(main.free), "18.265 ± 0.065 mm (spherometer)"))
    if inflation is not None:
        series = inflation.series
        top = np.nanmax(series.w_max_mm) if np.isfinite(series.w_max_mm).any() else float("nan")
        strain = np.nanmax(series.e1_max) if np.isfinite(series.e1_max).any() else float("nan")
        rows += [
            ("Membrane, largest w", _with(float(top), "mm"), ""),
            ("Membrane, w in the middle at 13 kPa, since the reference", _at_13_kpa(data), "about 6 mm"),
            ("Membrane, largest first principal strain", _with(100.0 * float(strain), "%"), ""),
            ("Membrane, frames", f"{len(series.number)}, {inflation.frames_lost} lost between them", ""),
            ("Membrane, frames a second", _with(inflation.frames_per_s, ""), "11"),
        ]
        if inflation.truth_w_rms_mm is not None:
            loaded = np.setdiff1d(np.arange(len(series.number)), inflation.reference_frames)
            worst = inflation.truth_w_rms_mm[loaded]
            if np.isfinite(worst).any():
                text = f"{number(float(np.nanmedian(worst)))} mm, worst frame {number(float(np.nanmax(worst)))} mm"
                rows.append(("Membrane, error of w, rms, median of frames (known on the twin)", text, ""))
    return Table("measured", ("figure", "this rig", "paper"), rows)


def merits_table(sphere: SphereData) -> Table:
    """The biprism beside the standard pair on the same sphere (the paper's "relative merits")."""
    shapes = sphere.shapes
    found = {shape.name: deviations(shape) for shape in shapes}
    names: list[tuple[str, list[str]]] = []
    if sphere.radius_mm is not None:
        title = f"Radial deviation, radius fixed at {number(sphere.radius_mm, 5)} mm"
        names.append((title, [_deviation(shape, shape.fixed) for shape in shapes]))
        names.append(
            (
                "The same with outliers, all valid points",
                [_deviation(shape, shape.fixed, outliers=True) for shape in shapes],
            )
        )
    names += [
        ("Radial deviation, radius free", [_deviation(shape, shape.free) for shape in shapes]),
        ("Radius, free", [_radius(shape.free) for shape in shapes]),
        ("Outliers to which the fit gave no weight", [_left_out(shape) for shape in shapes]),
        ("Stated sigma of x, y (depth), z, median", [_sigma(shape) for shape in shapes]),
        ("Stated sigma along the radius, rms", [_radial(found[shape.name]) for shape in shapes]),
        ("Points measured, of those with texture", [f"{shape.valid.sum()} of {len(shape.valid)}" for shape in shapes]),
        ("Seen area", [_with(shape.area_mm2, "mm²") for shape in shapes]),
        ("Image scale", [_with(sphere.mm_per_px.get(shape.name, np.nan), "mm/px") for shape in shapes]),
        ("Stereo angle", [_with(sphere.stereo_angle_deg.get(shape.name, np.nan), "°") for shape in shapes]),
        ("Frames needed for a shape", ["2, in step" if shape is sphere.standard else "1" for shape in shapes]),
    ]
    return Table("merits", ("quantity", *(shape.name for shape in shapes)), [(name, *row) for name, row in names])


def validity_table(data: MeasurementData) -> Table:
    """How many points were measured, and why the others were not."""
    counts = {shape.name: shape.counts for shape in _counted(data.sphere)}
    counts = {f"sphere, {name}": found for name, found in counts.items()}
    if data.inflation is not None:
        shown = data.inflation.shown
        state = _with(shown.pressure_kpa, "kPa") if np.isfinite(shown.pressure_kpa) else f"frame {shown.number}"
        counts[f"membrane, {state}"] = data.inflation.counts
    reasons = list(dict.fromkeys(reason for found in counts.values() for reason in found))
    rows = [(reason, *(f"{found.get(reason, 0)}" for found in counts.values())) for reason in reasons]
    return Table("validity", ("points", *counts), rows)


def practice_tables(data: MeasurementData) -> list[tuple[str, Table]]:
    """The iDICs guide's reporting table, a part a group, each with its caption."""
    keys = list(dict.fromkeys(key for column in data.practice for key in column.values))
    titles = [column.title for column in data.practice]
    tables = []
    for group in dict.fromkeys(group for group, _ in keys):
        rows = [
            (name, *(column.values.get((group, name), UNKNOWN) for column in data.practice))
            for here, name in keys
            if here == group
        ]
        table = Table(f"practice-{group.replace(' ', '-')}", (group, *titles), rows)
        tables.append((f"{group[:1].upper()}{group[1:]} parameters", table))
    return tables


def _counted(sphere: SphereData | None) -> list[Shape]:
    """Before and after are the same matches: counted once."""
    if sphere is None:
        return []
    return [shape for shape in (sphere.after, sphere.standard) if shape is not None]


def _deviation(shape: Shape, fit: SphereFit | None, *, outliers: bool = False) -> str:
    return UNKNOWN if fit is None else f"{mean_and_std(shape.deviation(fit, outliers=outliers))} mm"


def _radius(fit: SphereFit | None) -> str:
    return UNKNOWN if fit is None else f"{fit.radius_mm:.4f} ± {max(fit.radius_sigma_mm, 1e-4):.4f} mm"


def _left_out(shape: Shape) -> str:
    return UNKNOWN if shape.fit is None else f"{int(shape.valid.sum() - shape.fit.used.sum())}"


def _sigma(shape: Shape) -> str:
    known = shape.sigma_mm[shape.valid]
    if not np.isfinite(known).any():
        return "not stated"
    return ", ".join(number(1e3 * float(value), 2) for value in np.nanmedian(known, axis=0)) + " µm"


def _radial(found: Deviations | None) -> str:
    known = np.zeros(0) if found is None else found.sigma_mm[np.isfinite(found.sigma_mm)]
    return f"{number(1e3 * float(np.sqrt(np.mean(known**2))), 2)} µm" if known.size else "not stated"


def _at_13_kpa(data: MeasurementData) -> str:
    """W of the middle at the paper's pressure, linear between the frames around it."""
    series = None if data.inflation is None else data.inflation.series
    if series is None:
        return UNKNOWN
    known = np.isfinite(series.pressure_kpa) & np.isfinite(series.w_apex_mm)
    pressure, w = series.pressure_kpa[known], series.w_apex_mm[known]
    if not known.any() or not pressure.min() <= 13.0 <= pressure.max():
        return "not reached"
    order = np.argsort(pressure, kind="stable")
    return _with(float(np.interp(13.0, pressure[order], w[order])), "mm")


def _with(value: float, unit: str) -> str:
    return f"{number(value)} {unit}".strip() if np.isfinite(value) else UNKNOWN
