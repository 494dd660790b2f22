"""One adjustment of the reference pair: both cameras with their lenses, the dot grid, the axes and the stages.

It replaces the pinhole's biased triangulation as the source of reference points (DESIGN 3.1): the dots of a rigid
grid that stages move along straight lines lie where the adjusted lattice says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration.adjustment import MOTION_PARAMETERS, Adjustment, Seen, complex_slope, move
from bscd.calibration.dlt import DltCamera
from bscd.calibration.lens import LensCamera
from bscd.calibration.motion import TargetMotion
from bscd.calibration.moving_grid import fit_moving_grid
from bscd.calibration.observations import View
from bscd.calibration.reference import corner_cameras, pair_views, triangulate_pairs
from bscd.calibration.target import GridTarget
from bscd.errors import InputError

_CAMERAS = ("primary", "auxiliary")


@dataclass(frozen=True)
class Lattice:
    """The adjusted reference.

    ``cameras``: "primary" and "auxiliary"; ``motion``: the target's; ``motion_covariance`` ``(8, 8)`` of its
    parameters (rotation vector, translation, two angles of the direction); ``rms_px`` per camera: rms residual per
    axis.
    """

    cameras: Mapping[str, LensCamera]
    motion: TargetMotion
    motion_covariance: FloatArray
    rms_px: Mapping[str, float]

    def sigma_mm(self, points_mm: FloatArray, face: bool, y_mm: FloatArray | float) -> FloatArray:
        """One-sigma ``(N, 3)`` mm of lattice points given by their corner-pose positions ``(N, 3)``."""
        block, about = pack_motion(self.motion), self.motion.direction
        slopes = [
            complex_slope(lambda values: move(values, about, points_mm, face, y_mm), block, unit)
            for unit in np.eye(MOTION_PARAMETERS)
        ]
        design = np.stack(slopes, axis=-1)
        return np.sqrt(np.einsum("nij,jk,nik->ni", design, self.motion_covariance, design))


def adjust_lattice(
    views: Sequence[View],
    target: GridTarget,
    image_size_px: tuple[int, int],
    auxiliary_size_px: tuple[int, int] | None = None,
) -> Lattice:
    """Adjust the lattice to all reference views (corner at POS.0, face scan, optional corner scan).

    Parameters
    ----------
    views
        Views of "primary" and "auxiliary"; at least the corner at POS.0 and two face positions of each.
    image_size_px, auxiliary_size_px
        (width, height) of the primary camera's images and of the auxiliary one's (None: the same): the principal
        points are held near the middle by a weak prior.

    Raises
    ------
    InputError
        Views that leave the adjustment undetermined.
    """
    seen = {name: _flatten(views, target, name) for name in _CAMERAS}
    cameras = corner_cameras(views, target, _CAMERAS)
    start = _first_motion(views, target, cameras)
    sizes_px = {"primary": image_size_px, "auxiliary": auxiliary_size_px or image_size_px}
    adjustment = Adjustment(seen, start.direction, sizes_px)
    blocks = {name: LensCamera.from_matrix(camera.matrix).parameters for name, camera in cameras.items()}
    solved = adjustment.solve(pack_motion(start), blocks)
    return Lattice(
        {name: LensCamera(block) for name, block in solved.cameras.items()},
        TargetMotion(
            solved.direction,
            solved.motion[:3],
            solved.motion[3:6],
            start.corner_reading_deg,
            start.face_reading_deg,
        ),
        solved.covariance[:MOTION_PARAMETERS, :MOTION_PARAMETERS],
        solved.rms_px,
    )


def pack_motion(motion: TargetMotion) -> FloatArray:
    """The motion as the adjustment's parameters ``(8,)``; the direction is where its two angles are zero."""
    return np.concatenate([motion.face_rotation, motion.face_translation_mm, [0.0, 0.0]])


def _flatten(views: Sequence[View], target: GridTarget, camera: str) -> Seen:
    mine = [view for view in views if view.camera == camera]
    if not mine:
        raise InputError(f"reference: no views of the {camera} camera")
    return Seen(
        np.concatenate([target.points_mm(view.index) for view in mine]),
        np.concatenate([np.full(len(view.index), view.pose == "face") for view in mine]),
        np.concatenate([np.full(len(view.index), view.y_mm) for view in mine]),
        np.concatenate([view.xy_px for view in mine]),
        np.concatenate([view.sigma_px for view in mine]),
    )


def _reading(views: Sequence[View], pose: str) -> float:
    readings = [view.rotation_deg for view in views if view.pose == pose]
    if not readings:
        raise InputError(f"reference: no {pose} pose among the views")
    return float(np.mean(readings))


def _first_motion(views: Sequence[View], target: GridTarget, cameras: Mapping[str, DltCamera]) -> TargetMotion:
    """A start from triangulated face dots: a rigid fit with a free direction."""
    seen = pair_views([view for view in views if view.pose == "face"], *_CAMERAS)
    if len(np.unique(seen.y_mm)) < 2:
        raise InputError("reference: the face was seen by both cameras at fewer than 2 positions")
    xyz = triangulate_pairs(seen, cameras, *_CAMERAS, "linear")
    grid = fit_moving_grid(target.points_mm(seen.index), xyz, seen.y_mm)
    corner, face = _reading(views, "corner"), _reading(views, "face")
    if abs(corner - face) < 1.0:
        raise InputError(f"reference: corner and face pose have the same rotation reading ({corner:.2f} deg)")
    return TargetMotion(grid.direction, grid.rotation, grid.translation_mm, corner, face)
