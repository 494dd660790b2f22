"""The 8-bit copies that OpenCV's finders want."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from bscd.dic.images import PreparedImage


def eight_bit(reference: PreparedImage, current: PreparedImage) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Both images ``(H, W)`` as uint8, on one scale, so that brightness stays comparable.

    The scale is the reference's range less its extreme thousandths.
    """
    if reference.grey.dtype == np.uint8 and current.grey.dtype == np.uint8:
        return reference.grey, current.grey  # type: ignore[return-value]
    low, high = np.percentile(reference.grey, (0.1, 99.9))
    scale = 255.0 / max(float(high - low), 1e-12)

    def scaled(image: PreparedImage) -> NDArray[np.uint8]:
        grey = (np.asarray(image.grey, np.float32) - np.float32(low)) * np.float32(scale)
        return cv2.convertScaleAbs(np.clip(grey, 0.0, 255.0))  # type: ignore[return-value]

    return scaled(reference), scaled(current)
