"""What can be chosen in a calibration; without any library, so that configurations can name it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

ReferenceKind = Literal["lattice", "raw"]
ShiftSolver = Literal["projection", "smallest"]
Interpolant = Literal["smooth", "linear"]
TriangulationMethod = Literal["linear", "optimal"]


@dataclass(frozen=True)
class CalibrationChoices:
    """How a calibration was made; measuring uses the same."""

    reference: ReferenceKind = "lattice"
    solver: ShiftSolver = "projection"
    interpolant: Interpolant = "smooth"
    triangulation: TriangulationMethod = "optimal"
    degree: int = 4
