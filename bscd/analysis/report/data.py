"""What a report tells: results and where they came from, as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bscd.analysis.report.measurement import MeasurementData
from bscd.analysis.validation import ErrorFigure, Validation
from bscd.calibration import Calibration, GridTarget, View


@dataclass(frozen=True)
class RunOrigin:
    """A run file that the results came from: its name, uuid and SHA-256."""

    name: str
    uuid: str
    checksum: str


@dataclass(frozen=True)
class ReportData:
    """Everything that `bscd.analysis.report.write_report` writes down.

    ``pos0`` are dots of a second acquisition at POS.0 (corner or face), ``volume`` of one at positions between
    those of the scan; neither took part in the calibration. ``variants`` is ``volume`` once more for each pair
    (solver, interpolant). ``standard_stereo`` is the error of the reference pair. ``examples`` are 8-bit images
    ``(H, W)`` by their caption. With ``reference_views`` the residuals of the reference pair are shown as well; with
    a ``measurement`` what was measured with the calibration.
    """

    title: str
    started: datetime
    duration_s: float
    calibration: Calibration
    target: GridTarget
    image_size_px: tuple[int, int]
    pos0: Validation
    volume: Validation
    variants: Mapping[tuple[str, str], Validation]
    standard_stereo: ErrorFigure
    summary: Mapping[str, Any]
    config_text: str
    runs: Sequence[RunOrigin]
    warnings: Sequence[str] = ()
    examples: Mapping[str, NDArray[np.uint8]] = field(default_factory=dict)
    reference_views: Sequence[View] = ()
    measurement: MeasurementData | None = None

    @property
    def on_twin(self) -> bool:
        """Whether the true positions are known, as they are on the digital twin only."""
        return self.volume.truth_mm is not None
