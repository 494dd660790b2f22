"""Residuals of every image of a calibration, with the pinhole alone and with the full model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bscd.analysis.figures import ResidualField
from bscd.arrays import FloatArray
from bscd.calibration import Calibration, GridTarget, View
from bscd.calibration.adjustment import complex_slope
from bscd.calibration.lens import LensCamera, project_lens
from bscd.calibration.maps import fit_smooth_map

_ITERATIONS = 6


def camera_residuals(
    calibration: Calibration, reference_views: Sequence[View], target: GridTarget
) -> Mapping[str, tuple[ResidualField, ResidualField]]:
    """By image: residuals of the DLT camera in the corner pose at POS.0, and of the full model over all dots.

    The full model of the biprism image is the smooth distortion map, that of the reference cameras (shown when
    ``reference_views`` are given) a lens with distortion on the adjusted lattice.
    """
    fields = {"biprism": biprism_residuals(calibration)}
    for name, camera in calibration.reference.items():
        views = [view for view in reference_views if view.camera == name]
        if not views:
            continue
        corner = [view for view in views if view.pose == "corner" and view.position == 0]
        at = np.concatenate([view.xy_px for view in corner])
        ideal = np.concatenate([camera.project(target.points_mm(view.index)) for view in corner])
        points = np.concatenate(
            [calibration.motion.points_mm(target.points_mm(v.index), v.rotation_deg, v.y_mm) for v in views]
        )
        pixels = np.concatenate([view.xy_px for view in views])
        lens = _fit_lens(camera.matrix, points, pixels)
        fields[name] = (
            ResidualField(at, at - ideal, "pinhole", True),
            ResidualField(pixels, pixels - lens.project(points), "lens model", False),
        )
    return fields


def biprism_residuals(calibration: Calibration) -> tuple[ResidualField, ResidualField]:
    """Both halves of the biprism image together: they share its pixels."""
    control = calibration.control
    corner = ~control.face_pose & (control.position == 0)
    pixels = np.concatenate([control.left_px, control.right_px])
    misses = [
        image - camera.project(control.reference_mm)
        for camera, image in ((calibration.left, control.left_px), (calibration.right, control.right_px))
    ]
    shifts = calibration.choose("projection", calibration.choices.interpolant).shifts_px
    smooth = fit_smooth_map(control.distorted_mm, shifts, calibration.choices.degree)
    left = smooth.shifts_px(control.distorted_mm) - shifts
    both = np.tile(corner, 2)
    return (
        ResidualField(pixels[both], np.concatenate(misses)[both], "pinhole", True),
        ResidualField(pixels, np.concatenate([left[:, :2], left[:, 2:]]), "with the maps", False),
    )


def _fit_lens(matrix: FloatArray, points_mm: FloatArray, pixels_px: FloatArray) -> LensCamera:
    """The lens camera that sees points ``(N, 3)`` at ``(N, 2)`` px, from a pinhole camera ``(3, 4)`` (Gauss-Newton)."""
    parameters = LensCamera.from_matrix(matrix).parameters
    for _ in range(_ITERATIONS):
        miss = pixels_px - LensCamera(parameters).project(points_mm)
        slopes = [
            complex_slope(lambda values: project_lens(values, points_mm), parameters, unit).ravel()
            for unit in np.eye(parameters.size)
        ]
        design = np.stack(slopes, axis=1)
        scale = np.linalg.norm(design, axis=0)
        normal = (design / scale).T @ (design / scale)
        parameters = parameters + np.linalg.solve(normal, (design / scale).T @ miss.ravel()) / scale
    return LensCamera(parameters)
