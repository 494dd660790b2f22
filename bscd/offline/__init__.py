"""Calibrate and measure from files in one call, for notebooks, scripts and the command line."""

from bscd.offline.calibrate import calibrate, calibrate_files
from bscd.offline.measure import measure, open_results
from bscd.offline.measured_run import MeasuredRun

__all__ = ["MeasuredRun", "calibrate", "calibrate_files", "measure", "open_results"]
