"""Measuring: from a run and a calibration to shape, displacement and strain (DESIGN section 3, steps 4 to 6)."""

from bscd.procedures.measuring.measure import Measurement, measure_run, measure_to_file
from bscd.procedures.measuring.sequence import Measured, PointStatus, Sequence
from bscd.procedures.measuring.settings import MeasureSettings

__all__ = [
    "MeasureSettings",
    "Measured",
    "Measurement",
    "PointStatus",
    "Sequence",
    "measure_run",
    "measure_to_file",
]
