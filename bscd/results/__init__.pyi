from .counts import PointCounts, count_points
from .reader import ResultsFile
from .records import (
    VALID,
    FrameResult,
    MembraneFrame,
    Origin,
    ParameterValue,
    ResultsHeader,
    StereoSource,
)
from .writer import ResultsWriter

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
