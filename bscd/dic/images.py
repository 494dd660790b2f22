"""An image made ready for matching: checked, and filtered into spline coefficients once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from bscd.arrays import BoolArray, FloatArray
from bscd.dic.noise import Image, checked_image, checked_mask
from bscd.dic.spline import SplineName, spline_coefficients
from bscd.errors import InputError

#: Room around an image beyond the subset's radius: the kernel's vectors and the spline's taps.
_MARGIN_PX = 24

#: Sums of squares over a subset stay below what single precision holds.
_LARGEST_GREY = 1e12


@dataclass(frozen=True, eq=False)
class PreparedImage:
    """An image with its spline coefficients; prepare an image once that takes part in several correlations.

    ``grey`` ``(H, W)`` is the image (uint8, uint16 or float32), ``coefficients`` ``(H + 2 pad, W + 2 pad)`` float32, 0
    in columns far from any that is used, ``mask`` ``(H, W)`` uint8 or None: 0 where pixels are not to be used.
    ``subset_px`` is the largest subset that it serves.
    """

    grey: Image
    coefficients: FloatArray
    mask: NDArray[np.uint8] | None
    spline: SplineName
    pad_px: int
    subset_px: int

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        return self.grey.shape[0], self.grey.shape[1]


def prepare(
    image: Image,
    *,
    mask: BoolArray | None = None,
    interpolation: SplineName = "quintic",
    subset_px: int = 21,
    name: str = "image",
) -> PreparedImage:
    """Check an image ``(H, W)`` (integers or floats, finite) and filter it for subsets of up to ``subset_px``.

    ``mask`` ``(H, W)``: True where pixels may be used; a region of interest of any shape. ``name`` is what error
    messages call the image. Raises `InputError` for what is no such image or mask.
    """
    grey = checked_image(image, name)
    used = checked_mask(mask, grey.shape, f"mask of the {name}")
    if used is not None and not used.any():
        raise InputError(f"mask of the {name}: it leaves no pixel to use; True is where pixels may be used")
    if interpolation not in get_args(SplineName):
        raise InputError(f"interpolation: {interpolation!r} is none; {' or '.join(get_args(SplineName))} is needed")
    if grey.dtype == np.float32 and max(map(abs, cv2.minMaxLoc(grey)[:2])) > _LARGEST_GREY:
        raise InputError(f"{name}: grey levels beyond {_LARGEST_GREY:.0e} leave no room for their squares; scale them")
    if subset_px > min(grey.shape):
        raise InputError(f"subset_px: {subset_px} is larger than the {name}, {grey.shape[1]} x {grey.shape[0]} px")
    pad = subset_px // 2 + _MARGIN_PX
    coefficients = spline_coefficients(
        grey, interpolation, pad, None if used is None else np.atleast_1d(used.any(axis=0))
    )
    return PreparedImage(
        grey, coefficients, None if used is None else used.view(np.uint8), interpolation, pad, subset_px
    )
