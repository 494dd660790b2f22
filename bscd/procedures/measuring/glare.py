"""Glare: where an image is saturated over more than its speckles, it shows no surface."""

from __future__ import annotations

import cv2
import numpy as np

from bscd.arrays import BoolArray, FloatArray

#: A saturated area counts as glare when a square of this share of a subset fits into it: speckles are smaller.
_SHARE = 0.5

#: So far around it, in subsets, speckles' saturated parts belong to it.
_AROUND_SUBSETS = 3

#: So far beside it, in subsets, light changes too steeply for a match.
_BESIDE_SUBSETS = 0.5


def glare(image: FloatArray, subset_px: int) -> BoolArray | None:
    """Where an image ``(H, W)`` shows glare instead of a surface, ``(H, W)``; None when it has none.

    Saturated is what has the image's largest value; without saturation noise leaves no area of it. An image of one
    value, black or white, has no texture anywhere, which says enough.
    """
    brightest = image.max()
    if image.min() == brightest:
        return None
    saturated = (image >= brightest).view(np.uint8)
    side = max(int(_SHARE * subset_px), 3)
    if cv2.countNonZero(saturated) < side * side:
        return None
    areas = cv2.erode(saturated, np.ones((side, side), np.uint8))
    if not cv2.countNonZero(areas):
        return None
    reach = side + 2 * _AROUND_SUBSETS * subset_px
    near = cv2.dilate(areas, np.ones((reach, reach), np.uint8))
    beside = 2 * round(_BESIDE_SUBSETS * subset_px) + 1
    spoilt = cv2.dilate(saturated & near, np.ones((beside, beside), np.uint8))
    return spoilt.view(bool)
