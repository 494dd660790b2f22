"""The points that a field is measured at."""

from __future__ import annotations

import numpy as np

from bscd.arrays import BoolArray, FloatArray
from bscd.errors import InputError


def grid_points(
    shape_px: tuple[int, int], step_px: int, *, margin_px: int = 0, mask: BoolArray | None = None
) -> FloatArray:
    """Points ``(N, 2)`` (column, row) every ``step_px`` over an image (height, width), row by row.

    The grid is centred; it keeps ``margin_px`` from the borders and leaves out pixels where ``mask`` ``(H, W)`` is
    False. Raises `InputError` for a step below 1.
    """
    if step_px < 1:
        raise InputError(f"step_px: is {step_px}, at least 1 is needed")
    axes = []
    for size in shape_px[::-1]:
        room = size - 1 - 2 * margin_px
        axes.append(np.arange(room // step_px + 1) * step_px + margin_px + (room % step_px) // 2 if room >= 0 else [])
    columns, rows = np.meshgrid(*axes)
    points = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(np.float64)
    if mask is None or not len(points):
        return points
    if mask.shape != shape_px:
        raise InputError(f"mask: its shape is {mask.shape}, the image's {shape_px}; give one value a pixel")
    return points[np.asarray(mask)[points[:, 1].astype(int), points[:, 0].astype(int)] != 0]
