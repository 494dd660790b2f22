"""The tables of a report, as rows of text."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bscd.analysis.figures.depth_thirds import THIRDS
from bscd.analysis.figures.error_volume import worst_dots
from bscd.analysis.figures.sigma_histogram import error_over_sigma
from bscd.analysis.report.data import ReportData
from bscd.analysis.report.rounding import MINUS, mean_and_std, number
from bscd.analysis.report.table import Table
from bscd.analysis.validation import Validation
from bscd.arrays import FloatArray

SOLVERS = {
    "projection": "projection through the virtual cameras",
    "smallest": "smallest shifts that reach d = 0 (the paper's optimisation)",
}
INTERPOLANTS = {"smooth": "smooth polynomial", "linear": "piecewise linear on tetrahedra (as the paper)"}


def figures_table(data: ReportData) -> Table:
    """All figures beside the paper's, mm."""
    pos0, volume = data.pos0, data.volume
    rows = [
        (
            "Standard stereo pair, distance to the ideal dot grid",
            data.standard_stereo,
            "0.021 ± 0.032",
            "",
        ),
        (
            "Biprism, POS.0, before correction",
            pos0.figure("uncorrected"),
            "0.17 ± 0.10",
            "",
        ),
        (
            "Biprism, POS.0, after correction",
            pos0.figure("corrected"),
            "0.09 ± 0.05",
            "",
        ),
        ("Biprism, between the positions, before correction", volume.figure("uncorrected"), "", ""),
        ("Biprism, between the positions, after correction", volume.figure("corrected"), "", ""),
    ]
    for name, seen in (("POS.0", pos0), ("between the positions", volume)):
        if seen.truth_mm is None:
            continue
        rows.append((f"Biprism, {name}, after correction, to the truth", seen.figure("corrected", "truth"), "", "twin"))
        rows.append((f"Floor, {name}: the same images by exact rays", seen.figure("floor", "truth"), "", "twin"))
    body = [[name, mean_and_std(figure), f"{figure.count}", paper, note] for name, figure, paper, note in rows]
    return Table("figures", ("error d", "this rig (mm)", "dots", "paper (mm)", "known on the"), body, (2, 4))


def variants_table(data: ReportData) -> Table:
    """Both solvers and both interpolants on the dots of ``data.volume``, row for row; mm."""
    chosen = (data.calibration.choices.solver, data.calibration.choices.interpolant)
    heads = ["solver", "interpolant", "after correction (mm)", "worst dot (mm)", "within ±1 sigma"]
    if data.on_twin:
        heads[3:3] = ["to the truth (mm, twin)", "times the floor (twin)"]
    body, marked = [], []
    for place, (key, measured) in enumerate(data.variants.items()):
        seen = replace(measured, truth_mm=data.volume.truth_mm, floor_mm=data.volume.floor_mm)
        row = [SOLVERS.get(key[0], key[0]), INTERPOLANTS.get(key[1], key[1]), mean_and_std(seen.figure())]
        if data.on_twin:
            figure, floor = seen.figure("corrected", "truth"), seen.figure("floor", "truth")
            row += [mean_and_std(figure), number(figure.mean_mm / floor.mean_mm) if floor.count else ""]
        row += [number(_largest(seen)), _coverage(seen)]
        body.append(row)
        if key == chosen:
            marked.append(place)
    return Table("variants", heads, body, marked)


def thirds_table(data: ReportData) -> Table:
    """Before and after in each third of the depth, mm."""
    volume = data.volume
    depth = volume.expected_mm[:, 1]
    heads = ["third", "depth y (mm)", "dots", "before (mm)", "after (mm)"] + ["floor (mm, twin)"] * data.on_twin
    body = []
    for third, name in enumerate(THIRDS if volume.inside.any() else ()):
        here = volume.depth_third(third) & volume.inside
        after = volume.figure("corrected", where=here)
        span = f"{depth[here].min():+.1f} to {depth[here].max():+.1f}".replace("-", MINUS) if here.any() else ""
        row = [
            name,
            span,
            f"{after.count}",
            mean_and_std(volume.figure("uncorrected", where=here)),
            mean_and_std(after),
        ]
        body.append(row + [mean_and_std(volume.figure("floor", "truth", here))] * data.on_twin)
    return Table("thirds", heads, body)


def worst_table(data: ReportData) -> Table:
    """The worst dots after correction."""
    volume = data.volume
    before, after = volume.error_mm("uncorrected"), volume.error_mm("corrected")
    face, row, column = data.target.face_row_column(volume.index)
    body = [
        [
            f"{('right', 'left')[face[dot]]} face, row {row[dot]}, column {column[dot]}",
            _place(volume.expected_mm[dot]),
            number(float(before[dot])),
            number(float(after[dot])),
            number(float(np.linalg.norm(volume.sigma_mm[dot]))),
            number(float(volume.epipolar_px[dot]), 2),
        ]
        for dot in worst_dots(volume)
    ]
    heads = ("dot", "x, y, z (mm)", "before (mm)", "after (mm)", "sigma, all axes (mm)", "epipolar (px)")
    return Table("worst", heads, body)


def _place(point_mm: FloatArray) -> str:
    return ", ".join(f"{value:.1f}" for value in point_mm).replace("-", MINUS)


def _largest(seen: Validation) -> float:
    known = seen.error_mm()[np.isfinite(seen.error_mm())]
    return float(known.max()) if known.size else float("nan")


def _coverage(seen: Validation) -> str:
    ratio = error_over_sigma(seen)
    return f"{100.0 * np.mean(np.abs(ratio) < 1.0):.0f} %" if ratio.size else ""
