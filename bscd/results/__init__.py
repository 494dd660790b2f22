"""Results: measured shapes and displacements of a run, kept and read back; `bscd.results.export` hands them on."""

from bscd.results.counts import PointCounts, count_points
from bscd.results.reader import ResultsFile
from bscd.results.records import (
    VALID,
    FrameResult,
    MembraneFrame,
    Origin,
    ParameterValue,
    ResultsHeader,
    StereoSource,
)
from bscd.results.writer import ResultsWriter

__all__ = [
    "VALID",
    "FrameResult",
    "MembraneFrame",
    "Origin",
    "ParameterValue",
    "PointCounts",
    "ResultsFile",
    "ResultsHeader",
    "ResultsWriter",
    "StereoSource",
    "count_points",
]
