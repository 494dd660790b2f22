"""A frame's two views, made ready for matching."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bscd.acquisition import FrameRecord
from bscd.arrays import BoolArray
from bscd.calibration import Calibration
from bscd.dic import PreparedImage, prepare
from bscd.errors import InputError
from bscd.procedures.measuring.glare import glare

#: Columns on either side of the split line that show neither view alone.
_BLEND_PX = 4


@dataclass(frozen=True, eq=False)
class FrameViews:
    """The left and the right view of one frame."""

    left: PreparedImage
    right: PreparedImage


class BiprismSplitter:
    """Takes the halves of the biprism's images as views; both keep the sensor's pixel coordinates."""

    def __init__(self, calibration: Calibration, shape: tuple[int, int], subset_px: int) -> None:
        control = calibration.control
        left_end, right_start = float(control.left_px[:, 0].max()), float(control.right_px[:, 0].min())
        height, width = shape
        if not left_end < right_start:
            raise InputError("calibration: its left and right views overlap on the sensor; it is not of a biprism")
        if right_start > width - 1 or control.left_px[:, 1].max() > height - 1:
            raise InputError(
                f"calibration: it has dots at column {control.right_px[:, 0].max():.0f}, row "
                f"{control.left_px[:, 1].max():.0f}, the run's images are {width} x {height} px; "
                f"use the calibration of this camera and image size"
            )
        split = (left_end + right_start) / 2.0
        columns = np.broadcast_to(np.arange(width), shape)
        self.left_mask: BoolArray = np.ascontiguousarray(columns <= split - _BLEND_PX)
        self._right = np.ascontiguousarray(columns >= split + _BLEND_PX).view(np.uint8)
        self._subset_px = subset_px

    def views(self, image: np.ndarray) -> FrameViews:
        """Both halves ``(H, W)`` share one set of spline coefficients; glare is left out."""
        left = prepare(image, mask=self.left_mask, subset_px=self._subset_px, name="frame")
        halves = FrameViews(left, replace(left, mask=self._right))
        spoilt = glare(image, self._subset_px)
        return halves if spoilt is None else FrameViews(_without(halves.left, spoilt), _without(halves.right, spoilt))


def _without(view: PreparedImage, spoilt: BoolArray) -> PreparedImage:
    mask = ~spoilt if view.mask is None else view.mask.view(bool) & ~spoilt
    return replace(view, mask=mask.view(np.uint8))


def pair_views(primary: FrameRecord, auxiliary: FrameRecord, subset_px: int) -> FrameViews:
    """The standard pair's images; glare is left out."""
    views = []
    for frame in (primary, auxiliary):
        image = np.asarray(frame.data, np.float32)
        view, spoilt = prepare(image, subset_px=subset_px), glare(image, subset_px)
        views.append(view if spoilt is None else _without(view, spoilt))
    return FrameViews(*views)
