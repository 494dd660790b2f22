"""Initial guesses by searching a window for the highest ZNCC (paper, section 2.2.3: 21x21 in 41x41 px)."""

from __future__ import annotations

import cv2
import numpy as np

from bscd.arrays import FloatArray
from bscd.dic.images import PreparedImage


def guess_by_search(
    reference: PreparedImage,
    current: PreparedImage,
    points_px: FloatArray,
    about_px: FloatArray,
    subset_px: int,
    search_px: int,
) -> FloatArray:
    """Affine guesses ``(N, 6)`` (gradients 0): the whole-pixel displacement of highest ZNCC.

    The subset of each point ``(N, 2)`` is searched in a window ``search_px`` wide in the current image, displaced by
    ``about_px`` ``(N, 2)``; subsets and windows are cut at the images' borders. NaN where the window holds no place.
    """
    found = np.full((len(points_px), 6), np.nan)
    height, width = reference.shape
    first, second = (np.asarray(image.grey, np.float32) for image in (reference, current))
    radius, reach = subset_px // 2, max(search_px, subset_px) // 2
    corners = np.rint(points_px).astype(np.int64)
    shifts = np.rint(about_px).astype(np.int64)
    for i, ((column, row), (right, down)) in enumerate(zip(corners, shifts, strict=True)):
        left, top = max(column - radius, 0), max(row - radius, 0)
        template = first[top : min(row + radius + 1, height), left : min(column + radius + 1, width)]
        x0, y0 = max(column + right - reach, 0), max(row + down - reach, 0)
        window = second[y0 : max(row + down + reach + 1, 0), x0 : max(column + right + reach + 1, 0)]
        if template.size == 0 or window.shape[0] < template.shape[0] or window.shape[1] < template.shape[1]:
            continue
        score = cv2.matchTemplate(window, template, cv2.TM_CCOEFF_NORMED)
        _, _, _, (best_x, best_y) = cv2.minMaxLoc(score)
        found[i] = (x0 + best_x - left, 0.0, 0.0, y0 + best_y - top, 0.0, 0.0)
    return found
