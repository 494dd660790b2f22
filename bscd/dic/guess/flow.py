"""Initial guesses from dense optical flow (Kroeger et al. 2016, DIS, as OpenCV has it)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from bscd.arrays import FloatArray
from bscd.dic.guess.grey import eight_bit
from bscd.dic.images import PreparedImage

#: DIS's coarsest level must still hold its patches.
_SMALLEST_PX = 64

#: Flow is averaged over this square before it is read, and its gradients are taken over this distance.
_WINDOW_PX = 15
_BASELINE_PX = 8.0


class DenseFlow:
    """The flow from a reference to a current image."""

    def __init__(self, reference: PreparedImage, current: PreparedImage) -> None:
        self._flow: NDArray[np.float32] | None = None
        if min(reference.shape) >= _SMALLEST_PX:
            finder = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
            flow = finder.calc(*eight_bit(reference, current), None)  # type: ignore[call-overload]
            self._flow = cv2.blur(flow, (_WINDOW_PX, _WINDOW_PX))

    def at(self, points_px: FloatArray) -> FloatArray:
        """Affine guesses ``(N, 6)`` at points ``(N, 2)``; NaN for all when the images are too small."""
        if self._flow is None:
            return np.full((len(points_px), 6), np.nan)
        height, width = self._flow.shape[:2]
        away = np.array([(0, 0), (_BASELINE_PX, 0), (-_BASELINE_PX, 0), (0, _BASELINE_PX), (0, -_BASELINE_PX)])
        places = np.rint(np.clip(points_px[:, None] + away, 0, (width - 1, height - 1))).astype(np.int64)
        here, right, left, down, up = np.moveaxis(self._flow[places[..., 1], places[..., 0]].astype(np.float64), 1, 0)
        along = np.maximum(places[:, 1, 0] - places[:, 2, 0], 1)[:, None]
        across = np.maximum(places[:, 3, 1] - places[:, 4, 1], 1)[:, None]
        by_column, by_row = (right - left) / along, (down - up) / across
        return np.stack([here[:, 0], by_column[:, 0], by_row[:, 0], here[:, 1], by_column[:, 1], by_row[:, 1]], axis=1)
