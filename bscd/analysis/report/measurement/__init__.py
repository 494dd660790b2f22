"""The measuring part of a report: a sphere, an inflation, and how they were measured."""

from bscd.analysis.report.measurement.data import (
    NOT_RECORDED,
    InflationData,
    InflationMap,
    InflationSeries,
    MeasurementData,
    PracticeColumn,
    RestNoise,
    Shape,
    SphereData,
)

__all__ = [
    "NOT_RECORDED",
    "InflationData",
    "InflationMap",
    "InflationSeries",
    "MeasurementData",
    "PracticeColumn",
    "RestNoise",
    "Shape",
    "SphereData",
]
