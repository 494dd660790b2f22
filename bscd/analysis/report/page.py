"""Write a report: `report.html`, whole in itself, and a PNG of every figure in `figures/`."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bscd.analysis.report.calibration_tables import choices_table, residual_table, runs_table, versions_table
from bscd.analysis.report.data import ReportData
from bscd.analysis.report.measurement.page import measurement_cards, measurement_sections
from bscd.analysis.report.measurement.pictures import measurement_pictures
from bscd.analysis.report.pictures import draw_pictures
from bscd.analysis.report.rendering import place_pictures, write_page
from bscd.analysis.report.rounding import duration, mean_and_std, number
from bscd.analysis.report.tables import figures_table, thirds_table, variants_table, worst_table

_EXAMPLE_WIDTH_PX = 1000
_JPEG_QUALITY = 82


def write_report(data: ReportData, folder: Path) -> Path:
    """Write ``report.html`` and ``figures/*.png`` into a folder, made if need be; the page's path.

    The page needs no network, no script and no other file.
    """
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    pictures = place_pictures(draw_pictures(data), figures)
    examples = [_place_example(caption, image, figures) for caption, image in data.examples.items()]
    measured = data.measurement
    if measured is not None:
        pictures |= place_pictures(measurement_pictures(measured), figures)
    return write_page(
        "report.html",
        folder,
        data=data,
        started=data.started.strftime("%Y-%m-%d %H:%M %Z").strip(),
        took=duration(data.duration_s),
        cards=_cards(data) + ([] if measured is None else measurement_cards(measured)),
        pictures=pictures,
        examples=examples,
        figures=figures_table(data),
        variants=variants_table(data),
        thirds=thirds_table(data),
        worst=worst_table(data),
        residuals=residual_table(data.calibration),
        choices=choices_table(data.calibration),
        runs=runs_table(data),
        versions=versions_table(data),
        summary=json.dumps(_without_nan(data.summary), indent=2),
        measurement=None if measured is None else measurement_sections(measured),
    )


def _place_example(caption: str, image: NDArray[np.uint8], folder: Path) -> dict[str, str]:
    """Save the image in full beside the page; a smaller one goes into it."""
    name = "".join(letter if letter.isalnum() else "_" for letter in caption.lower()).strip("_")
    (folder / f"{name}.png").write_bytes(_encode(".png", image, []))
    height, width = image.shape
    scale = min(1.0, _EXAMPLE_WIDTH_PX / width)
    smaller = cv2.resize(image, (round(width * scale), round(height * scale)), interpolation=cv2.INTER_AREA)
    encoded = _encode(".jpg", np.asarray(smaller, np.uint8), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    uri = "data:image/jpeg;base64," + base64.b64encode(encoded).decode("ascii")
    return {"caption": f"{caption[:1].upper()}{caption[1:]} ({width} x {height} px)", "uri": uri}


def _encode(suffix: str, image: NDArray[np.uint8], settings: Sequence[int]) -> bytes:
    """An image file's bytes."""
    return cv2.imencode(suffix, image, settings)[1].tobytes()


def _cards(data: ReportData) -> list[dict[str, str]]:
    """The figures that an operator looks for first."""
    volume, inside = data.volume, float(np.mean(data.volume.inside))
    before, after = volume.figure("uncorrected"), volume.figure("corrected")
    gain = number(before.mean_mm / after.mean_mm, 2) if after.count and after.mean_mm > 0.0 else ""
    return [
        {
            "name": "Error after correction",
            "value": mean_and_std(after),
            "unit": "mm",
            "note": f"{mean_and_std(before)} mm before" + (f": {gain} times better" if gain else ""),
        },
        {
            "name": "At POS.0",
            "value": mean_and_std(data.pos0.figure("corrected")),
            "unit": "mm",
            "note": f"{mean_and_std(data.pos0.figure('uncorrected'))} mm before",
        },
        {
            "name": "Standard stereo pair",
            "value": mean_and_std(data.standard_stereo),
            "unit": "mm",
            "note": "two cameras, no prism: the reference",
        },
        {
            "name": "Dots inside the hull",
            "value": f"{100.0 * inside:.0f}",
            "unit": "%",
            "note": f"{int(volume.inside.sum())} of {len(volume.inside)} of the second acquisition",
        },
    ]


def _without_nan(value: Any) -> Any:
    """JSON has no NaN: null where a number is not known."""
    if isinstance(value, Mapping):
        return {str(name): _without_nan(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
