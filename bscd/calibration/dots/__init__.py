"""Dots and marks in images: found, labelled and measured; pure functions on arrays."""

from bscd.calibration.dots.findings import (
    GridFinding,
    MarkFinding,
    Marks,
    MarkSeed,
    MissingDot,
    Seed,
    SplitLine,
    SplitRegion,
)
from bscd.calibration.dots.grid import find_grid
from bscd.calibration.dots.marks import find_marks
from bscd.calibration.dots.matching import match_marks
from bscd.calibration.dots.split import find_split

__all__ = [
    "GridFinding",
    "MarkFinding",
    "MarkSeed",
    "Marks",
    "MissingDot",
    "Seed",
    "SplitLine",
    "SplitRegion",
    "find_grid",
    "find_marks",
    "find_split",
    "match_marks",
]
