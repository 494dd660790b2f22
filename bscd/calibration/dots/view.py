"""The part of an image to look in: the whole of it, or one half beside the split line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration.dots.findings import SplitRegion
from bscd.errors import InputError

_GUARD_PX = 2.0  # pixels beside a line that was seen mix both halves
_CUT_PX = 0.5  # a rim this far across the image's border is cut
_CLEAR_OF_SPLIT_PX = 1.0  # a rim nearer to a line that was seen is taken as cut

CUT_BY_SPLIT, CUT_BY_BORDER = "cut by the split line", "cut by the image's border"
BEYOND_SPLIT, OUTSIDE = "beyond the split line", "outside the image"


@dataclass(frozen=True)
class View2D:
    """Columns that belong to the view: ``limits_px`` ``(H, 2)`` first and last in each row; the image's size.

    ``edge_px`` ``(H, 2)`` are the columns where the view really ends: the split line or the image's border.
    """

    limits_px: FloatArray
    edge_px: FloatArray
    width_px: int
    split_side: int
    tolerance_px: float

    @staticmethod
    def of(shape: tuple[int, ...], region: SplitRegion | None) -> View2D:
        """The view of an image of this shape; ``InputError`` if the split line is not on it."""
        height, width = shape[0], shape[1]
        limits = np.tile([0.0, width - 1.0], (height, 1))
        edge = np.tile([-0.5, width - 0.5], (height, 1))
        if region is None:
            return View2D(limits, edge, width, -1, _CUT_PX)
        line = region.split.column_at(np.arange(height, dtype=np.float64))
        if line.min() < 8 or line.max() > width - 9:
            raise InputError(f"split line: column {region.split.column_px:.0f} px is not inside the image")
        guard = _GUARD_PX if region.split.found else 0.0
        side = 1 if region.half == "left" else 0
        limits[:, side] = np.floor(line) - guard if side else np.ceil(line) + guard
        edge[:, side] = line
        tolerance = -_CLEAR_OF_SPLIT_PX if region.split.found else _CUT_PX
        return View2D(limits, edge, width, side, tolerance)

    @property
    def columns(self) -> tuple[int, int]:
        """First and last column that has any pixel of the view."""
        return int(self.limits_px[:, 0].min()), int(self.limits_px[:, 1].max())

    def _rows(self, y: FloatArray) -> np.ndarray:
        return np.clip(np.rint(np.nan_to_num(y)), 0, len(self.limits_px) - 1).astype(int)

    def contains(self, xy_px: FloatArray) -> np.ndarray:
        """Whether points ``(N, 2)`` are in the view."""
        edge = self.edge_px[self._rows(xy_px[:, 1])]
        rows = (xy_px[:, 1] >= -0.5) & (xy_px[:, 1] <= len(self.limits_px) - 0.5)
        return rows & (xy_px[:, 0] >= edge[:, 0]) & (xy_px[:, 0] <= edge[:, 1])

    def overlaps(self, xy_px: FloatArray, shape: FloatArray) -> np.ndarray:
        """Whether most of an ellipse (centre ``(N, 2)``, shape ``(N, 2, 2)`` px^2) is in the view."""
        half = 0.5 * np.sqrt(shape[:, [0, 1], [0, 1]])
        return self.contains(xy_px - half) & self.contains(xy_px + half)

    def cut(self, xy_px: FloatArray, shape: FloatArray) -> np.ndarray:
        """Why ellipses are cut, ``(N,)`` text; empty for whole ones."""
        wide, high = np.sqrt(shape[:, 0, 0]), np.sqrt(shape[:, 1, 1])
        x, y = xy_px[:, 0], xy_px[:, 1]
        edge = self.edge_px[self._rows(y)]
        over = np.stack([edge[:, 0] - (x - wide), (x + wide) - edge[:, 1]])
        border = (over > _CUT_PX).any(axis=0) | (high - y > 0.5 + _CUT_PX)
        border |= y + high > len(self.limits_px) - 0.5 + _CUT_PX
        reason = np.where(border, CUT_BY_BORDER, "").astype(object)
        if self.split_side >= 0:
            reason[over[self.split_side] > self.tolerance_px] = CUT_BY_SPLIT
        return reason

    def absence(self, xy_px: FloatArray, shape: FloatArray) -> list[str]:
        """Why ellipses that do not overlap the view are not seen."""
        reasons = []
        for place, cut in zip(xy_px, self.cut(xy_px, shape), strict=True):
            edge = self.edge_px[self._rows(place[1:2])[0]]
            across = place[0] < edge[0] if self.split_side == 0 else place[0] > edge[1]
            if self.split_side >= 0 and across and 0 <= place[0] < self.width_px:
                reasons.append(BEYOND_SPLIT)
            elif not self.contains(place[None])[0]:
                reasons.append(OUTSIDE)
            else:
                reasons.append(str(cut) or CUT_BY_BORDER)
        return reasons
