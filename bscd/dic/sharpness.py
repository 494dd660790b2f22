"""How sharp an image shows its speckle: a blurred one is no good reference."""

from __future__ import annotations

import cv2
import numpy as np

from bscd.arrays import FloatArray
from bscd.dic.images import PreparedImage


def sharpness_per_px(image: PreparedImage, points_px: FloatArray, subset_px: int) -> float:
    """Root mean square of the grey level's slope over its standard deviation, 1/px: the subsets' median.

    For subsets about points ``(N, 2)`` of an image; light and contrast do not change it, a stretch does by its factor.
    NaN without points.
    """
    if not len(points_px):
        return float("nan")
    low = np.maximum(np.floor(points_px.min(axis=0)).astype(int) - subset_px, 0)
    high = np.ceil(points_px.max(axis=0)).astype(int) + subset_px + 1
    grey = np.asarray(image.grey[low[1] : high[1], low[0] : high[0]], np.float32)
    grey = grey - grey.mean()
    columns, rows = (cv2.Sobel(grey, cv2.CV_32F, *axis, scale=0.125) for axis in ((1, 0), (0, 1)))
    around = (subset_px, subset_px)
    slope = cv2.blur(columns * columns + rows * rows, around)
    variance = cv2.blur(grey * grey, around) - cv2.blur(grey, around) ** 2
    column, row = np.clip(np.rint(points_px).astype(int) - low, 0, np.array(grey.shape[::-1]) - 1).T
    return float(np.sqrt(np.median(slope[row, column] / np.maximum(variance[row, column], 1e-6))))
