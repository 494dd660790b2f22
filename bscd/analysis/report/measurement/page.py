"""The measuring part as a page of its own, and as sections of a larger one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bscd.analysis.report.measurement.data import MeasurementData, Shape
from bscd.analysis.report.measurement.pictures import measurement_pictures
from bscd.analysis.report.measurement.tables import measured_table, merits_table, practice_tables, validity_table
from bscd.analysis.report.rendering import place_pictures, write_page
from bscd.analysis.report.rounding import MINUS, UNKNOWN, number
from bscd.analysis.report.table import Table


@dataclass(frozen=True, eq=False)
class MeasurementReport:
    """A page about a measurement alone: when it was made (text), from which files, and the warnings given."""

    title: str
    made: str
    data: MeasurementData
    origins: Sequence[tuple[str, str, str]] = ()
    """File, uuid and SHA-256 of run, calibration and results."""
    warnings: Sequence[str] = ()
    config_text: str = ""
    parameters: dict[str, Any] = field(default_factory=dict)
    """Every parameter of the measurement, by name."""


def write_measurement_report(report: MeasurementReport, folder: Path) -> Path:
    """Write ``report.html`` and ``figures/*.png`` into a folder, made if need be; the page's path.

    The page needs no network, no script and no other file.
    """
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    return write_page(
        "measurement.html",
        folder,
        report=report,
        pictures=place_pictures(measurement_pictures(report.data), figures),
        cards=measurement_cards(report.data),
        measurement=measurement_sections(report.data),
        origins=Table("origins", ("file", "uuid", "SHA-256"), report.origins),
    )


def measurement_sections(data: MeasurementData) -> dict[str, Any]:
    """What the sections' template needs beside the figures."""
    return {
        "data": data,
        "measured": measured_table(data),
        "merits": None if data.sphere is None else merits_table(data.sphere),
        "validity": validity_table(data),
        "practice": practice_tables(data),
    }


def measurement_cards(data: MeasurementData) -> list[dict[str, str]]:
    """The figures that an operator looks for first."""
    cards = []
    sphere = data.sphere
    main = None if sphere is None else sphere.after or sphere.standard
    if sphere is not None and main is not None and main.fit is not None:
        before = None if sphere.before is None or sphere.before is main else sphere.before
        cards.append(
            {
                "name": "Sphere, radial deviation",
                "value": _deviation_um(main),
                "unit": "µm",
                "note": "" if before is None or before.fit is None else f"{_deviation_um(before)} µm before correction",
            }
        )
    if data.inflation is not None:
        series = data.inflation.series
        known = np.isfinite(series.w_max_mm)
        pressure = series.pressure_kpa[known & np.isfinite(series.pressure_kpa)]
        cards.append(
            {
                "name": "Membrane, largest w",
                "value": number(float(series.w_max_mm[known].max())) if known.any() else UNKNOWN,
                "unit": "mm",
                "note": f"up to {number(float(pressure.max()))} kPa, {len(series.number)} frames"
                if pressure.size
                else f"{len(series.number)} frames",
            }
        )
        noise = data.inflation.noise
        if noise is not None:
            cards.append(
                {
                    "name": "Noise floor of w",
                    "value": number(1e3 * float(noise.displacement_mm[2]), 2),
                    "unit": "µm",
                    "note": f"{number(1e3 * float(max(noise.displacement_mm[:2])), 2)} µm of u and v, at rest",
                }
            )
    return cards


def _deviation_um(shape: Shape) -> str:
    if shape.fit is None:
        return UNKNOWN
    figure = shape.deviation(shape.fit)
    return f"{round(1e3 * figure.mean_mm, 1) + 0.0:.1f} ± {1e3 * figure.std_mm:.1f}".replace("-", MINUS)
