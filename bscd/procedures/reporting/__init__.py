"""From results files and their runs to what a report tells."""

from bscd.procedures.reporting.gather import gather_measurement
from bscd.procedures.reporting.source import Source

__all__ = ["Source", "gather_measurement"]
