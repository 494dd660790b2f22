"""A frame's two views, made ready for matching."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import BoolArray
from bscd.calibration import Calibration
from bscd.dic import PreparedImage, prepare
from bscd.errors import InputError
from bscd.procedures.measuring.glare import glare

#: Columns on either side of the split line that show neither view alone.
_BLEND_PX = 4

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")

FrameImages = tuple[NDArray[Any], ...]
"""A frame's images ``(H, W)``: the primary camera's, and the auxiliary one's with it for the standard pair."""


@dataclass(frozen=True, eq=False)
class FrameViews:
    """The left and the right view of one frame."""

    left: PreparedImage
    right: PreparedImage


class BiprismSplitter:
    """Takes the halves of the biprism's images as views; both keep the sensor's pixel coordinates.

    ``split_px`` is the column between them; it is pickled without its masks.
    """

    def __init__(self, split_px: float, shape: tuple[int, int], subset_px: int) -> None:
        self._made_from = (split_px, shape, subset_px)
        columns = np.broadcast_to(np.arange(shape[1]), shape)
        self.left_mask: BoolArray = np.ascontiguousarray(columns <= split_px - _BLEND_PX)
        self.right_mask: BoolArray = np.ascontiguousarray(columns >= split_px + _BLEND_PX)
        self._subset_px = subset_px

    @classmethod
    def of(cls, calibration: Calibration, shape: tuple[int, int], subset_px: int) -> BiprismSplitter:
        """For a calibration's rig and images ``(H, W)``; raises `InputError` where its views are no halves."""
        control = calibration.control
        left_end, right_start = float(control.left_px[:, 0].max()), float(control.right_px[:, 0].min())
        if not left_end < right_start:
            raise InputError("calibration: its left and right views overlap on the sensor; it is not of a biprism")
        return cls((left_end + right_start) / 2.0, shape, subset_px)

    def __reduce__(self) -> tuple[type[BiprismSplitter], tuple[float, tuple[int, int], int]]:
        """What it was made from."""
        return BiprismSplitter, self._made_from

    def views(self, image: np.ndarray) -> FrameViews:
        """Both halves of an image ``(H, W)``; glare is left out."""
        spoilt = glare(image, self._subset_px)
        return FrameViews(*(self._half(image, side, spoilt) for side in SIDES))

    def view(self, side: Side, image: np.ndarray) -> PreparedImage:
        """One of them, for half the work."""
        return self._half(image, side, glare(image, self._subset_px))

    def _half(self, image: np.ndarray, side: Side, spoilt: BoolArray | None) -> PreparedImage:
        mask = self.left_mask if side == "left" else self.right_mask
        view = prepare(image, mask=mask, subset_px=self._subset_px, name="frame")
        view = replace(view, grey=np.asarray(view.grey, np.float32))  # the reference is a mean, and has no other type
        return view if spoilt is None else _without(view, spoilt)


def _without(view: PreparedImage, spoilt: BoolArray) -> PreparedImage:
    mask = ~spoilt if view.mask is None else view.mask.view(bool) & ~spoilt
    return replace(view, mask=mask.view(np.uint8))


def pair_view(image: np.ndarray, subset_px: int) -> PreparedImage:
    """An image of the standard pair; glare is left out."""
    view, spoilt = prepare(image, subset_px=subset_px), glare(image, subset_px)
    return view if spoilt is None else _without(view, spoilt)


@dataclass(frozen=True, eq=False)
class ViewSource:
    """Makes views of frames' images, also in another process: by the splitter, or of a pair's (None)."""

    splitter: BiprismSplitter | None
    subset_px: int

    def views(self, images: FrameImages) -> FrameViews:
        """Both views."""
        if self.splitter is not None:
            return self.splitter.views(images[0])
        return FrameViews(*(pair_view(np.asarray(image, np.float32), self.subset_px) for image in images))

    def view(self, side: Side, images: FrameImages) -> PreparedImage:
        """One of them, as `views` makes it."""
        if self.splitter is not None:
            return self.splitter.view(side, images[0])
        return pair_view(np.asarray(images[SIDES.index(side)], np.float32), self.subset_px)
