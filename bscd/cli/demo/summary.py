"""The demo's figures: summary.json as DESIGN section 5 has it, and the same beside the paper's for the terminal."""

from __future__ import annotations

from typing import Any

from bscd.analysis.report.measurement import MeasurementData, Shape
from bscd.analysis.surface import radial_deviation
from bscd.analysis.validation import ErrorFigure, Validation
from bscd.arrays import FloatArray
from bscd.calibration import Calibration
from bscd.cli.demo.calibrating import standard_stereo
from bscd.errors import CheckFailedError


def summarise(
    calibration: Calibration,
    pos0: Validation,
    volume: Validation,
    measured: MeasurementData,
    inflation: dict[str, Any],
    sphere_centre_mm: FloatArray,
) -> dict[str, Any]:
    """All figures, mm. The sphere's deviations are from the sphere of the nominal radius, ``radius`` is measured.

    ``truth_...`` are about its true centre ``(3,)``, without a fit.
    """
    sphere = measured.sphere
    if (
        sphere is None
        or sphere.radius_mm is None
        or sphere.before is None
        or sphere.after is None
        or sphere.after.free is None
    ):
        raise CheckFailedError("the demo's sphere could not be measured; look at sphere-result.h5")
    return {
        "reference": standard_stereo(calibration).summary(),
        "bsc_pos0": {which: pos0.figure(which).summary() for which in ("uncorrected", "corrected")},
        "volume": {
            "uncorrected": volume.figure("uncorrected").summary(),
            "corrected": volume.figure("corrected").summary(),
            "truth_corrected": volume.figure("corrected", "truth").summary(),
            "truth_floor": volume.figure("floor", "truth").summary(),
        },
        "sphere": {
            "radius": sphere.after.free.radius_mm,
            "uncorrected": _deviation(sphere.before),
            "corrected": _deviation(sphere.after),
            "truth_uncorrected": _about(sphere.before, sphere_centre_mm, sphere.radius_mm),
            "truth_corrected": _about(sphere.after, sphere_centre_mm, sphere.radius_mm),
        },
        "inflation": inflation,
    }


def told(summary: dict[str, Any]) -> list[str]:
    """The figures in lines, with the paper's beside them."""

    def line(name: str, figure: dict[str, float], paper: str = "") -> str:
        return f"{name:<34}{figure['mean']:8.4f} +- {figure['std']:.4f} mm{paper}"

    pos0, volume = summary["bsc_pos0"], summary["volume"]
    sphere, inflation = summary["sphere"], summary["inflation"]
    return [
        line("standard stereo", summary["reference"], "   (paper 0.021 +- 0.032)"),
        line("biprism at POS.0, uncorrected", pos0["uncorrected"], "   (paper 0.17 +- 0.10)"),
        line("biprism at POS.0, corrected", pos0["corrected"], "   (paper 0.09 +- 0.05)"),
        line("volume, uncorrected", volume["uncorrected"]),
        line("volume, corrected", volume["corrected"]),
        line("volume, corrected, against truth", volume["truth_corrected"]),
        line("floor (exact rays, same pixels)", volume["truth_floor"]),
        line("sphere, uncorrected", sphere["uncorrected"], "   (paper 0.32 +- 0.10)"),
        line("sphere, corrected", sphere["corrected"], "   (paper 0.00056 +- 0.08)"),
        line("sphere, uncorrected, about truth", sphere["truth_uncorrected"]),
        line("sphere, corrected, about truth", sphere["truth_corrected"]),
        f"{'sphere, radius':<34}{sphere['radius']:8.4f} mm             (paper 18.265 +- 0.065, by spherometer)",
        f"{'inflation, highest w':<34}{inflation['w_max']:8.4f} mm             (paper about 6 at 13 kPa)",
        f"{'inflation, error of w':<34}{inflation['truth_w_rms']:8.4f} mm rms, against truth",
        f"{'inflation, worst frame':<34}{_worst(inflation)}",
        f"{'inflation, recorded':<34}{inflation['frames']:8d} frames at {inflation['fps']:.2f} fps, "
        f"{inflation['dropped']} dropped (paper 11 fps)",
        f"{'inflation, measured':<34}{inflation['points']:8d} points at {inflation['live_fps']:.1f} fps",
    ]


def _worst(inflation: dict[str, Any]) -> str:
    u, v, w = (inflation["truth_worst"][name] for name in "uvw")
    return f"{w:8.4f} mm rms in w, {u:.4f} in u, {v:.4f} in v, {100 * inflation['kept_worst']:.1f} % of points kept"


def _deviation(shape: Shape) -> dict[str, float]:
    if shape.fixed is None:
        raise CheckFailedError(f"no sphere fits what the demo measured ({shape.name}); look at sphere-result.h5")
    return shape.deviation(shape.fixed).summary()


def _about(shape: Shape, centre_mm: FloatArray, radius_mm: float) -> dict[str, float]:
    return ErrorFigure.of(radial_deviation(shape.xyz_mm[shape.valid], centre_mm, radius_mm)).summary()
