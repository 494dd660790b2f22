"""The standard stereo pair: its DLT cameras, the raw reference points, and its error (paper, section 2.2.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.calibration.choices import TriangulationMethod
from bscd.calibration.dlt import DltCamera, DltMethod, fit_dlt
from bscd.calibration.moving_grid import fit_moving_grid
from bscd.calibration.observations import View
from bscd.calibration.target import GridTarget
from bscd.calibration.triangulation import triangulate
from bscd.errors import InputError


@dataclass(frozen=True)
class Paired:
    """Dots seen by two cameras in the same pose and position, one row each.

    ``first_px``, ``second_px`` ``(N, 2)``; ``index``, ``position`` ``(N,)``; ``face_pose`` ``(N,)`` bool; stage
    readings ``y_mm``, ``rotation_deg`` ``(N,)``.
    """

    index: IntArray
    position: IntArray
    face_pose: BoolArray
    y_mm: FloatArray
    rotation_deg: FloatArray
    first_px: FloatArray
    second_px: FloatArray

    def select(self, mask: BoolArray) -> Paired:
        """The rows of a mask."""
        return Paired(*(getattr(self, name)[mask] for name in self.__dataclass_fields__))


def pair_views(views: Sequence[View], first: str, second: str) -> Paired:
    """What cameras ``first`` and ``second`` both saw. Raises `InputError` when that is nothing."""
    by_key = {(view.camera, view.pose, view.position): view for view in views}
    columns: list[tuple[NDArray[np.generic], ...]] = []
    for (camera, pose, position), one in by_key.items():
        other = by_key.get((second, pose, position))
        if camera != first or other is None:
            continue
        both, at_one, at_other = np.intersect1d(one.index, other.index, return_indices=True)
        size = len(both)
        columns.append(
            (
                both,
                np.full(size, position),
                np.full(size, pose == "face"),
                np.full(size, one.y_mm),
                np.full(size, one.rotation_deg),
                one.xy_px[at_one],
                other.xy_px[at_other],
            )
        )
    if not columns:
        raise InputError(f"calibration: no position was seen in both the {first} and the {second} view")
    return Paired(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def corner_cameras(
    views: Sequence[View], target: GridTarget, names: Sequence[str], method: DltMethod = "refined"
) -> dict[str, DltCamera]:
    """The DLT of each named view from the target's corner pose at POS.0. Raises `InputError` without it."""
    cameras = {}
    for name in names:
        corner = [view for view in views if (view.camera, view.pose, view.position) == (name, "corner", 0)]
        if not corner:
            raise InputError(f"calibration: no corner pose at POS.0 in the {name} view; image it first")
        cameras[name] = fit_dlt(target.points_mm(corner[0].index), corner[0].xy_px, method)
    return cameras


def triangulate_pairs(
    paired: Paired, cameras: Mapping[str, DltCamera], first: str, second: str, method: TriangulationMethod
) -> FloatArray:
    """Positions ``(N, 3)`` mm of paired dots."""
    matrices = [cameras[first].matrix, cameras[second].matrix]
    return triangulate(matrices, [paired.first_px, paired.second_px], method).xyz_mm


def lattice_error_mm(paired: Paired, xyz_mm: FloatArray, target: GridTarget) -> FloatArray:
    """Distance ``(N,)`` mm of triangulated face dots to the ideal lattice (paper: 0.021 +- 0.032 mm).

    The lattice is placed by a rigid fit in which the translation's direction is free.
    """
    grid = target.points_mm(paired.index)
    fitted = fit_moving_grid(grid, xyz_mm, paired.y_mm)
    return np.linalg.norm(fitted.points_mm(grid, paired.y_mm) - xyz_mm, axis=1)
