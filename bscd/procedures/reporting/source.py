"""A results file with the run and the calibration that it came from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.acquisition import FrameRecord, RunFile
from bscd.arrays import BoolArray, FloatArray
from bscd.calibration import Calibration
from bscd.errors import InputError
from bscd.procedures.measuring.frames import FrameChoice, choose_frames, frame_records
from bscd.results import ResultsFile


@dataclass(frozen=True, eq=False)
class Source:
    """What a report is made from; raises `InputError` when run or calibration are not those of the results."""

    results: ResultsFile
    run: RunFile
    calibration: Calibration

    def __post_init__(self) -> None:
        """Refuse files that do not belong together."""
        origin = self.results.header.run
        if origin.checksum and origin.checksum != self.run.checksum:
            raise InputError(f"{self.results.path}: it was measured from another run than {self.run.path}")
        if self.results.header.calibration.checksum != self.calibration.checksum:
            raise InputError(f"{self.results.path}: it was measured with another calibration")

    @property
    def phase(self) -> str:
        """Which frames were measured: sphere or inflation."""
        return str(self.results.header.parameters["phase"])

    @property
    def choice(self) -> FrameChoice:
        """The frames of the run that were measured."""
        phase = "sphere" if self.phase == "sphere" else "inflation"
        return choose_frames(self.run, phase, self.results.header.stereo, self.calibration.jack_mm)

    def reference_record(self) -> FrameRecord:
        """The first frame of the reference, of the primary camera."""
        return next(frame_records(self.run, self.choice))[0]

    def rows(self) -> np.ndarray:
        """The run's table of the frames that were measured, in their order."""
        table = self.run.table("primary", self.choice.phase)
        return table[np.isin(table["sequence_number"], self.choice.primary)]


def known(values: FloatArray, where: BoolArray) -> FloatArray:
    """Values with NaN wherever a point does not count."""
    return np.where(where.reshape(-1, *(1,) * (values.ndim - 1)), values, np.nan)
