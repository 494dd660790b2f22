"""Dots and marks in images: found, labelled and measured; pure functions on arrays."""

from bscd.calibration.dots.findings import GridFinding, Marks, MissingDot, Seed, SplitLine, SplitRegion
from bscd.calibration.dots.grid import find_grid

__all__ = [
    "GridFinding",
    "Marks",
    "MissingDot",
    "Seed",
    "SplitLine",
    "SplitRegion",
    "find_grid",
]
