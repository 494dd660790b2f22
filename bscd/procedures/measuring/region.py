"""The points that are measured: a grid over the left view, where there is texture."""

from __future__ import annotations

import cv2
import numpy as np

from bscd.arrays import BoolArray, FloatArray
from bscd.dic import PreparedImage, grid_points, speckle_quality
from bscd.errors import InputError

#: A subset whose noise lets expect more than this is no texture to measure on.
_SIGMA_PX = 0.1


def requested_points(
    left: PreparedImage, step_px: int, subset_px: int, noise_grey: float, region: BoolArray | None
) -> FloatArray:
    """Points ``(N, 2)`` every ``step_px`` in the region, or without one wherever subsets have texture.

    Raises `InputError` when there are none.
    """
    mask = None if left.mask is None else left.mask.astype(bool)
    if region is not None:
        if region.shape != left.shape:
            raise InputError(f"region: its shape is {region.shape}, the images' {left.shape}; give one value a pixel")
        mask = region.astype(bool) if mask is None else mask & region.astype(bool)
    points = grid_points(left.shape, step_px, mask=mask)
    if region is None and len(points):
        quality = speckle_quality(left.grey, points, subset_px=subset_px, noise_grey=noise_grey, mask=mask)
        points = points[(quality.sigma_px < _SIGMA_PX).all(axis=1)]
    if not len(points):
        raise InputError("the reference frame has no speckled surface in the left view; check image, light and region")
    return points


def covered_mask(shape: tuple[int, ...], points_px: FloatArray, subset_px: int) -> BoolArray:
    """Where points' subsets lie in an image, ``(H, W)``."""
    mask = np.zeros(shape, np.uint8)
    columns, rows = np.rint(points_px).astype(int).T
    mask[rows, columns] = 1
    return cv2.dilate(mask, np.ones((subset_px, subset_px), np.uint8)).astype(bool)
