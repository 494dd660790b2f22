"""Where everything stands in a results file, for the writer and the reader; ``docs/results-file.md`` explains it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.hdf5 import FileKind

RESULTS_FILE = FileKind(
    name="results file",
    definition="bscd_results",
    version="2",
    source="a file of bscd measure",
    restore="copy it again from where it was measured, or measure again",
    for_folder="give the file that bscd measure made",
    keep="results are never overwritten",
    after_crash="its frames can be read; to go on measure into a new file",
)

DATA = "entry/data"
MEASUREMENT = "entry/measurement"
PARAMETERS = "entry/process/parameters"
FRAME_SHA256 = "entry/recording/frame_sha256"

#: The column whose rows make frames valid: written last, so a crash never leaves half a frame.
COMMIT_COLUMN = "frame_number"


@dataclass(frozen=True, slots=True)
class Quantity:
    """Something measured at every point of a frame: ``shape`` is that of a point's value."""

    name: str
    shape: tuple[int, ...]
    dtype: str
    unit: str
    description: str

    @property
    def fill(self) -> float | int:
        """What stands where nothing was written: NaN, and for codes one that is never given."""
        return np.nan if np.dtype(self.dtype).kind == "f" else 255


#: Positions keep the full precision; for the rest float32 resolves far more than was measured.
QUANTITIES: tuple[Quantity, ...] = (
    Quantity("xyz_mm", (3,), "<f8", "mm", "position in this frame, world frame"),
    Quantity("displacement_mm", (3,), "<f8", "mm", "displacement since the reference, world frame"),
    Quantity("uvw_mm", (3,), "<f8", "mm", "displacement u, v, w in the membrane frame"),
    Quantity("strain", (3,), "<f4", "", "Green-Lagrange strain exx, eyy, exy in the membrane frame"),
    Quantity("principal", (2,), "<f4", "", "principal strains e1, e2"),
    Quantity("principal_direction", (3,), "<f4", "", "direction of e1 on the reference surface, world frame"),
    Quantity("sigma_mm", (3,), "<f4", "mm", "one-sigma uncertainty of the position"),
    Quantity("displacement_sigma_mm", (3,), "<f4", "mm", "one-sigma uncertainty of the displacement"),
    Quantity("zncc", (), "<f4", "", "zero-mean normalised cross-correlation of the match"),
    Quantity("epipolar_px", (), "<f4", "px", "distance of the match from its epipolar line"),
    Quantity("status", (), "|u1", "", "0 where the point was measured, else the reason's code"),
    Quantity("left_px", (2,), "<f8", "px", "column, row in the left view"),
    Quantity("right_px", (2,), "<f8", "px", "column, row in the right view"),
)

#: A value a frame: name, type, fill, unit, description.
COLUMNS: tuple[tuple[str, str, float, str, str], ...] = (
    ("time_s", "<f8", np.nan, "s", "time since the start of the inflation"),
    ("pressure_kpa", "<f8", np.nan, "kPa", "gauge pressure"),
    ("displacement_max_mm", "<f8", np.nan, "mm", "largest displacement of a valid point"),
    ("epipolar_median_px", "<f8", np.nan, "px", "median distance of the matches from their epipolar lines"),
    ("valid_fraction", "<f8", np.nan, "", "part of the requested points that is valid"),
    (COMMIT_COLUMN, "<i8", -1, "", "number of the frame as recorded, from 0"),
)
