from .measure import Measurement, measure_run, measure_to_file
from .sequence import Measured, PointStatus, Sequence
from .settings import MeasureSettings

__all__ = [
    "MeasureSettings",
    "Measured",
    "Measurement",
    "PointStatus",
    "Sequence",
    "measure_run",
    "measure_to_file",
]
