"""The report: one self-contained page with every figure of a calibration, and its pictures beside it."""

from bscd.analysis.report.data import ReportData, RunOrigin
from bscd.analysis.report.page import write_report

__all__ = ["ReportData", "RunOrigin", "write_report"]
