"""Tables of the calibration itself: how it was made, what it left over, and where everything came from."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import version

import numpy as np

from bscd.analysis.report.data import ReportData
from bscd.analysis.report.rounding import duration, number
from bscd.analysis.report.table import Table
from bscd.analysis.report.tables import INTERPOLANTS, SOLVERS
from bscd.arrays import FloatArray
from bscd.calibration import Calibration
from bscd.version import __version__

_NAMES = {
    "standard_stereo_error_mean_mm": "Standard stereo pair, mean distance to the dot grid",
    "standard_stereo_error_std_mm": "Standard stereo pair, standard deviation of it",
    "standard_stereo_points": "Standard stereo pair, dots",
    "left_dlt_rms_px": "Left view, pinhole (DLT), rms per axis",
    "right_dlt_rms_px": "Right view, pinhole (DLT), rms per axis",
    "primary_dlt_rms_px": "Primary camera, pinhole (DLT), rms per axis",
    "auxiliary_dlt_rms_px": "Auxiliary camera, pinhole (DLT), rms per axis",
    "primary_lattice_rms_px": "Primary camera, lens model on the lattice, rms per axis",
    "auxiliary_lattice_rms_px": "Auxiliary camera, lens model on the lattice, rms per axis",
    "map_residual_rms_px": "Distortion maps, rms per axis",
    "control_points": "Control points",
    "positions": "Positions of the scan",
}
_UNITS = ("px", "mm", "deg")
_REFERENCES = {"lattice": "lattice: one adjustment of both cameras, grid and stages", "raw": "raw: as the paper"}
_PACKAGES = ("numpy", "scipy", "numba", "opencv-python-headless", "h5py", "matplotlib")


def residual_table(calibration: Calibration) -> Table:
    """The calibration's own figures and limits, with their units."""
    figures = dict(calibration.figures)
    body = [[_NAMES.get(name, _plain_name(name)), _with_unit(name, value)] for name, value in figures.items()]
    body.append(["Standard uncertainty of a dot's image coordinate", _with_unit("sigma_px", calibration.sigma_px)])
    body.append(
        ["Epipolar residual above which the rig counts as moved", _with_unit("limit_px", calibration.epipolar_limit_px)]
    )
    return Table("calibration-residuals", ("quantity", "value"), body)


def choices_table(calibration: Calibration) -> Table:
    """How the calibration was made, and the stages' axes as it found them."""
    chosen, motion = calibration.choices, calibration.motion
    body = [
        ["Reference", _REFERENCES[chosen.reference]],
        ["Shifts", SOLVERS[chosen.solver]],
        ["Maps", f"{INTERPOLANTS[chosen.interpolant]}, degree {chosen.degree}"],
        ["Triangulation", chosen.triangulation],
        ["Calibrated volume (x, y, z)", _volume(calibration)],
        ["Jack height during the biprism scan", _with_unit("jack_mm", calibration.jack_mm)],
        ["Translation stage, direction off y", _with_unit("deg", _angle_deg(motion.direction, [0.0, 1.0, 0.0]))],
        ["Rotation stage, axis off z", _with_unit("deg", _angle_deg(motion.axis, [0.0, 0.0, 1.0]))],
        ["Rotation stage, axis nearest to the origin at (x, y, z)", _triple(motion.axis_point_mm)],
        [
            "Rotation readings, corner and face",
            f"{motion.corner_reading_deg:.2f} and {motion.face_reading_deg:.2f} deg",
        ],
    ]
    if chosen.interpolant == "linear":
        body[2][1] = INTERPOLANTS["linear"]
    return Table("calibration-choices", ("what", "how"), body)


def runs_table(data: ReportData) -> Table:
    """The run files with uuid and checksum, and the calibration's own checksum."""
    body = [[run.name, run.uuid, run.checksum] for run in data.runs]
    body.append(["calibration", "", data.calibration.checksum])
    return Table("runs", ("file", "uuid", "SHA-256"), body)


def versions_table(data: ReportData) -> Table:
    """When it was made and by which programs."""
    body = [
        ["started", data.started.isoformat(sep=" ", timespec="seconds")],
        ["took", duration(data.duration_s)],
        ["bscd", __version__],
        ["Python", f"{platform.python_version()} on {platform.system()} {platform.machine()}"],
    ]
    body += [[name, version(name)] for name in _PACKAGES]
    return Table("versions", ("what", "version"), body)


def _plain_name(name: str) -> str:
    words = name.split("_")
    return " ".join(words[:-1] if words[-1] in _UNITS else words).capitalize()


def _with_unit(name: str, value: float) -> str:
    unit = name.rsplit("_", 1)[-1]
    text = f"{value:.0f}" if unit not in _UNITS and np.isfinite(value) and value == round(value) else number(value)
    return f"{text} {unit}" if unit in _UNITS and np.isfinite(value) else text


def _angle_deg(direction: FloatArray, nominal: Sequence[float]) -> float:
    return float(np.degrees(np.arccos(np.clip(direction @ np.asarray(nominal), -1.0, 1.0))))


def _triple(values: FloatArray) -> str:
    return "(" + ", ".join(number(value) for value in values) + ") mm"


def _volume(calibration: Calibration) -> str:
    size = np.ptp(calibration.control.distorted_mm, axis=0)
    return " x ".join(f"{value:.1f}" for value in size) + " mm"
