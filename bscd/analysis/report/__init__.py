"""The report: one self-contained page with every figure of a calibration and of what was measured, and its pictures."""

from bscd.analysis.report.data import ReportData, RunOrigin
from bscd.analysis.report.measurement.page import MeasurementReport, write_measurement_report
from bscd.analysis.report.page import write_report

__all__ = ["MeasurementReport", "ReportData", "RunOrigin", "write_measurement_report", "write_report"]
