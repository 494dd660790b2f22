"""Validation of a calibration on dots that took no part in it (paper, section 2.2.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.calibration import Calibration, GridTarget, View, pair_views, with_nominal_rotation


@dataclass(frozen=True)
class ErrorFigure:
    """Mean and standard deviation of distances, in mm, over ``count`` points."""

    mean_mm: float
    std_mm: float
    count: int

    @classmethod
    def of(cls, distances_mm: FloatArray) -> ErrorFigure:
        """The figure of distances ``(N,)``; NaN for none."""
        known = distances_mm[np.isfinite(distances_mm)]
        if known.size == 0:
            return cls(float("nan"), float("nan"), 0)
        return cls(float(known.mean()), float(known.std()), int(known.size))

    def summary(self) -> dict[str, float]:
        """As in summary.json."""
        return {"mean": self.mean_mm, "std": self.std_mm}


@dataclass(frozen=True)
class Validation:
    """Dots of an acquisition of their own, reconstructed with and without the correction; M rows.

    ``expected_mm`` ``(M, 3)`` is where the reference and the stage readings put a dot; ``index``, ``y_mm``,
    ``face_pose`` ``(M,)`` say which dot it is; ``left_px``, ``right_px`` ``(M, 2)`` its images. ``uncorrected_mm``,
    ``corrected_mm``, ``sigma_mm`` ``(M, 3)`` are the reconstruction; outside the hull (``inside`` False) the
    corrected ones are NaN. ``truth_mm`` and ``floor_mm`` ``(M, 3)`` exist on the digital twin only: the true
    position, and the same images reconstructed with the twin's exact rays.
    """

    index: IntArray
    y_mm: FloatArray
    face_pose: BoolArray
    left_px: FloatArray
    right_px: FloatArray
    expected_mm: FloatArray
    uncorrected_mm: FloatArray
    corrected_mm: FloatArray
    sigma_mm: FloatArray
    epipolar_px: FloatArray
    inside: BoolArray
    truth_mm: FloatArray | None = None
    floor_mm: FloatArray | None = None

    def error_mm(self, which: str = "corrected", against: str = "expected") -> FloatArray:
        """Distances ``(M,)`` of "uncorrected", "corrected" or "floor" to "expected" or "truth", inside the hull.

        NaN outside the hull, so that every figure counts the same points.
        """
        measured, true = getattr(self, f"{which}_mm"), getattr(self, f"{against}_mm")
        if measured is None or true is None:
            return np.full(len(self.index), np.nan)
        return np.where(self.inside, np.linalg.norm(measured - true, axis=1), np.nan)

    def figure(
        self, which: str = "corrected", against: str = "expected", where: BoolArray | None = None
    ) -> ErrorFigure:
        """Mean and standard deviation of `error_mm`, over a mask ``(M,)`` when given."""
        error = self.error_mm(which, against)
        return ErrorFigure.of(error if where is None else error[where])

    def depth_third(self, third: int) -> BoolArray:
        """Mask ``(M,)`` of one third (0, 1, 2) of the depth that the points inside the hull span."""
        depth = self.expected_mm[:, 1]
        low, high = depth[self.inside].min(), depth[self.inside].max()
        place = np.clip(np.floor(3.0 * (depth - low) / (high - low)), 0, 2)
        return place == third


def validate(calibration: Calibration, views: Sequence[View], target: GridTarget) -> Validation:
    """Reconstruct the dots of views "left" and "right" of an acquisition that took no part in the calibration.

    Where the dots should be follows from the reference's measured axes and the views' stage readings.
    """
    seen = pair_views(with_nominal_rotation(views), "left", "right")
    expected = np.empty((len(seen.index), 3))
    for reading in np.unique(seen.rotation_deg):
        here = seen.rotation_deg == reading
        grid = target.points_mm(seen.index[here])
        expected[here] = calibration.motion.points_mm(grid, float(reading), seen.y_mm[here])
    plain = calibration.reconstruct(seen.first_px, seen.second_px, corrected=False)
    corrected = calibration.reconstruct(seen.first_px, seen.second_px)
    return Validation(
        index=seen.index,
        y_mm=seen.y_mm,
        face_pose=seen.face_pose,
        left_px=seen.first_px,
        right_px=seen.second_px,
        expected_mm=expected,
        uncorrected_mm=plain.xyz_mm,
        corrected_mm=corrected.xyz_mm,
        sigma_mm=corrected.sigma_mm,
        epipolar_px=corrected.epipolar_px,
        inside=corrected.inside,
    )


def compare_variants(
    calibration: Calibration, views: Sequence[View], target: GridTarget
) -> Mapping[tuple[str, str], Validation]:
    """The same validation with both solvers and both interpolants, keyed (solver, interpolant)."""
    return {
        (solver, interpolant): validate(calibration.choose(solver, interpolant), views, target)
        for solver in ("projection", "smallest")
        for interpolant in ("smooth", "linear")
    }
