"""Figures of a labelled grid in one image: scale, roll, extent, sharpness; what alignment is judged by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from bscd.arrays import FloatArray, IntArray
from bscd.calibration.dots import GridFinding
from bscd.calibration.dots.findings import Image
from bscd.calibration.target import GridTarget

_SMOOTHING_PX = 1.0
_DIFFERENCE_VARIANCE_PX2 = 1.0 / 3.0  # a central difference is a mean slope over two pixels
_MOST_DOTS = 60


@dataclass(frozen=True)
class GridFigures:
    """One grid as one camera, or one half of the biprism image, sees it.

    ``pitch_px`` is the mean distance of neighbouring dots of a column, ``roll_deg`` how far the columns lean in
    the image, positive clockwise; ``centre_px`` (column, row) and ``height_px`` are of the dots' extent,
    ``brightness`` the light between the dots as a share of full scale, ``edge_sigma_px`` the Gaussian blur of
    the dots' edges.
    """

    dots: int
    pitch_px: float
    roll_deg: float
    centre_px: tuple[float, float]
    height_px: float
    brightness: float
    edge_sigma_px: float
    saturated_share: float


def grid_figures(image: Image, full_scale: float, finding: GridFinding, target: GridTarget) -> GridFigures:
    """Measure a grid that was found in ``image`` ``(H, W)``."""
    columns = column_steps_px(finding.index, finding.xy_px, target)
    mean_step = columns.mean(axis=0)
    pitch_px = float(np.median(np.linalg.norm(columns, axis=1)))
    low, high = finding.xy_px.min(axis=0), finding.xy_px.max(axis=0)
    middle = (low + high) / 2.0
    radius_px = target.dot_diameter_mm / target.pitch_mm * pitch_px / 2.0
    patches = _patches(image, finding.xy_px, radius_px)
    return GridFigures(
        dots=len(finding.index),
        pitch_px=pitch_px,
        roll_deg=float(np.degrees(np.arctan2(-mean_step[0], mean_step[1]))),
        centre_px=(float(middle[0]), float(middle[1])),
        height_px=float(high[1] - low[1]),
        brightness=float(np.median([np.percentile(patch, 90.0) for patch in patches])) / full_scale,
        edge_sigma_px=float(np.median([edge_sigma_px(patch) for patch in patches])),
        saturated_share=finding.saturated_fraction,
    )


def column_steps_px(index: IntArray, xy_px: FloatArray, target: GridTarget) -> FloatArray:
    """Image vectors ``(M, 2)`` px from dots to their lower neighbours on the same face."""
    _, row, _ = target.face_row_column(index)
    place = {int(label): k for k, label in enumerate(index)}
    upper = [k for k, label in enumerate(index) if row[k] + 1 < target.rows and int(label) + target.columns in place]
    lower = [place[int(index[k]) + target.columns] for k in upper]
    return np.asarray(xy_px)[lower] - np.asarray(xy_px)[upper]


def edge_sigma_px(patch: Image) -> float:
    """Gaussian blur (sigma, px) of the dot's edge in a patch that holds one dot and its surroundings.

    A step of height C blurred by sigma has the steepest slope C / (sigma sqrt(2 pi)); the smoothing that is
    added against noise, and that of the finite difference, are taken off again.
    """
    smooth = gaussian_filter(np.asarray(patch, np.float64), _SMOOTHING_PX)
    down, across = np.gradient(smooth)
    slope = np.hypot(down, across)
    contrast = np.percentile(smooth, 95.0) - np.percentile(smooth, 5.0)
    steepest = np.percentile(slope, 99.5)
    if steepest <= 0.0:
        return float("inf")
    sigma = contrast / (steepest * np.sqrt(2.0 * np.pi))
    return float(np.sqrt(max(sigma**2 - _SMOOTHING_PX**2 - _DIFFERENCE_VARIANCE_PX2, 0.0)))


def _patches(image: Image, xy_px: FloatArray, radius_px: float) -> list[Image]:
    """Squares about evenly chosen dots, one radius beyond their edge."""
    half = int(np.ceil(1.7 * radius_px)) + 1
    height_px, width_px = image.shape
    patches = []
    for column, row in np.rint(xy_px[:: max(1, len(xy_px) // _MOST_DOTS)]).astype(int):
        if half <= column < width_px - half and half <= row < height_px - half:
            patches.append(image[row - half : row + half + 1, column - half : column + half + 1])
    return patches or [image]
