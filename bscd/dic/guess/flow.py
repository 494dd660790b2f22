"""Initial guesses from dense optical flow (Kroeger et al. 2016, DIS, as OpenCV has it)."""

from __future__ import annotations

import cv2
import numpy as np

from bscd.arrays import FloatArray
from bscd.dic.guess.grey import eight_bit
from bscd.dic.images import PreparedImage

#: DIS's coarsest level must still hold its patches.
_SMALLEST_PX = 64

#: Flow is averaged over this square before it is read, and its gradients are taken over this distance.
_WINDOW_PX = 15
_BASELINE_PX = 8.0


def guess_by_flow(reference: PreparedImage, current: PreparedImage, points_px: FloatArray) -> FloatArray:
    """Affine guesses ``(N, 6)`` at points ``(N, 2)``; NaN for all when the images are too small."""
    height, width = reference.shape
    if min(height, width) < _SMALLEST_PX:
        return np.full((len(points_px), 6), np.nan)
    flow = _flow(*eight_bit(reference, current))
    smooth = cv2.blur(flow, (_WINDOW_PX, _WINDOW_PX))
    away = np.array([(0, 0), (_BASELINE_PX, 0), (-_BASELINE_PX, 0), (0, _BASELINE_PX), (0, -_BASELINE_PX)])
    places = np.clip(points_px[:, None] + away, 0, (width - 1, height - 1))
    nearest = np.rint(places).astype(np.int64)
    here, right, left, down, up = np.moveaxis(smooth[nearest[..., 1], nearest[..., 0]].astype(np.float64), 1, 0)
    along = np.maximum(nearest[:, 1, 0] - nearest[:, 2, 0], 1)[:, None]
    across = np.maximum(nearest[:, 3, 1] - nearest[:, 4, 1], 1)[:, None]
    by_column, by_row = (right - left) / along, (down - up) / across
    return np.stack([here[:, 0], by_column[:, 0], by_row[:, 0], here[:, 1], by_column[:, 1], by_row[:, 1]], axis=1)


def _flow(reference: np.ndarray, current: np.ndarray) -> np.ndarray:
    finder = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
    return finder.calc(reference, current, None)  # type: ignore[call-overload]
