"""What is known of a point's two images in a frame: noise, what left and right share of it, and the field's scatter."""

from __future__ import annotations

import numpy as np

from bscd.arrays import BoolArray, FloatArray
from bscd.calibration import ImageCovariances
from bscd.dic import Correlation
from bscd.dic.curvature import Curvature
from bscd.dic.tracker_state import Tracked
from bscd.procedures.measuring.uncertainty_kernel import both_views, half_sum_and_difference, image_covariances


class Uncertainty:
    """Of N points that were matched in the reference's views ``left_px`` and ``right_px`` ``(N, 2)``."""

    def __init__(self, stereo: Correlation, left_px: FloatArray, right_px: FloatArray, subset_px: int) -> None:
        self._stereo = stereo
        self._start = left_px, right_px
        self._field = Curvature(left_px, subset_px)
        self._stray = np.zeros(len(left_px), bool)

    @property
    def stray(self) -> BoolArray:
        """Which points once strayed from their field, ``(N,)``: all that one frame leaves for the next."""
        return self._stray.copy()

    @stray.setter
    def stray(self, which: BoolArray) -> None:
        self._stray = which.copy()

    def of_reference(self) -> ImageCovariances:
        """Of the reference frame itself: the left image defines the point, the stereo match places the right one."""
        stereo = self._stereo.covariance_px2
        position = np.zeros((len(stereo), 4, 4))
        position[:, 2:, 2:] = stereo
        onward = np.tile(np.eye(2), (len(stereo), 1, 1))
        return ImageCovariances(np.zeros_like(position), stereo, onward, position)

    def of_frame(self, left: Tracked, right: Tracked) -> ImageCovariances:
        """Of a tracked frame.

        The right reference's noise moves the stereo match and the tracking that starts from it in opposite ways, so it
        is not in the position; the left reference's moves both views' positions alike. What scatters about the smooth
        field beyond the noise (`Curvature.scatter`) is added, as far as both views have it in common or apart.
        """
        stereo, count = self._stereo, len(self._stray)
        across, both = np.empty((count, 2, 2)), np.empty((count, 2, 2))
        both_views(
            left.gradient, right.gradient, stereo.gradient, left.covariance_px2, right.covariance_px2, across, both
        )
        alike, apart = self._scatter(left, right, across, both)
        onward = np.eye(2) + right.gradient
        tracking, position = np.empty((count, 4, 4)), np.empty((count, 4, 4))
        image_covariances(
            across,
            both,
            onward,
            alike,
            apart,
            left.covariance_px2,
            left.reference_px2,
            right.covariance_px2,
            right.reference_px2,
            stereo.covariance_px2,
            tracking,
            position,
        )
        return ImageCovariances(tracking, stereo.covariance_px2, onward, position)

    def _scatter(
        self, left: Tracked, right: Tracked, across: FloatArray, both: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Scatter ``(N,)`` of the half sum of both views' errors, and of their difference, over the noise's variance.

        The two are independent where both views are equally sure; ``both`` ``(N, 2, 2)`` is their noise in the right
        view, where ``across`` takes the left one's. Points that once strayed from their field, as at an edge, say
        nothing of their neighbours any more.
        """
        known = (left.valid & right.valid & ~self._stray)[:, None]
        moved, other = (
            self._field.residual_px(np.where(known, view.position_px - start, np.nan))
            for view, start in zip((left, right), self._start, strict=True)
        )
        middle, difference = np.empty_like(moved), np.empty_like(moved)
        half_sum_and_difference(across, moved, other, middle, difference)
        alike, strayed = self._field.scatter(middle, both / 4.0)
        self._stray |= strayed
        apart, strayed = self._field.scatter(difference, both)
        self._stray |= strayed
        return alike, apart
