"""All that a report tells of one or more results files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bscd.analysis.report.measurement import MeasurementData
from bscd.arrays import FloatArray
from bscd.procedures.reporting.inflation import inflation_data
from bscd.procedures.reporting.practice import practice_column
from bscd.procedures.reporting.source import Source
from bscd.procedures.reporting.sphere import sphere_data

_TITLES = {
    ("sphere", "biprism"): "sphere, biprism",
    ("sphere", "standard"): "sphere, standard pair",
    ("inflation", "biprism"): "inflation, biprism",
    ("inflation", "standard"): "inflation, standard pair",
}


def gather_measurement(
    sources: Sequence[Source],
    *,
    sphere_radius_mm: float | None = None,
    facts: Mapping[str, str] | None = None,
    truth_w_rms_mm: FloatArray | None = None,
) -> MeasurementData:
    """Read results of a sphere (by either pair of views) and of an inflation.

    ``sphere_radius_mm`` is the nominal radius where it is known. ``facts`` are "lens", "aperture", "light" and
    "pattern" in words, of the setup. ``truth_w_rms_mm`` ``(T,)`` is known on the twin alone.
    """
    found = {(source.phase, source.results.header.stereo): source for source in sources}
    pressed = found.get(("inflation", "biprism")) or found.get(("inflation", "standard"))
    inflation = None if pressed is None else inflation_data(pressed, truth_w_rms_mm)
    columns = []
    for key, source in found.items():
        shown = inflation if source is pressed else None
        noise, why = (shown.noise, shown.why_no_noise) if shown else (None, "")
        columns.append(practice_column(source, _TITLES[key], noise, why, facts or {}))
    sphere = sphere_data(found.get(("sphere", "biprism")), found.get(("sphere", "standard")), sphere_radius_mm)
    return MeasurementData(sphere, inflation, tuple(columns))
