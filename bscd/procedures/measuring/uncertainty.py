"""What is known of a point's two images in a frame: noise, what left and right share of it, and the field's scatter."""

from __future__ import annotations

import numpy as np

from bscd.arrays import BoolArray, FloatArray
from bscd.calibration import ImageCovariances
from bscd.dic import Correlation
from bscd.dic.curvature import Curvature
from bscd.dic.tracker_state import Tracked


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
        stereo = self._stereo
        onward = np.eye(2) + right.gradient
        # how the left view's place in this frame maps to the right view's
        across = onward @ (np.eye(2) + stereo.gradient) @ np.linalg.inv(np.eye(2) + left.gradient)
        back = np.swapaxes(across, 1, 2)
        position, apart = self._excess(left, right, across)
        position[:, :2, :2] += left.covariance_px2
        tracking = position.copy()
        tracking[:, 2:, 2:] += right.covariance_px2
        shared = across @ left.reference_px2
        position[:, 2:, :2] += shared
        position[:, :2, 2:] += np.swapaxes(shared, 1, 2)
        position[:, 2:, 2:] += shared @ back + right.covariance_px2 - right.reference_px2
        # of the stereo match so much is what the tracking has too, scatter included; what it has more is its own
        same = shared @ back + right.reference_px2
        own = onward @ stereo.covariance_px2 @ np.swapaxes(onward, 1, 2)
        times = np.trace(np.linalg.solve(same, own), axis1=1, axis2=2) / 2.0
        position[:, 2:, 2:] += np.maximum(times / apart - 1.0, 0.0)[:, None, None] * same
        return ImageCovariances(tracking, stereo.covariance_px2, onward, position)

    def _excess(self, left: Tracked, right: Tracked, across: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Covariance ``(N, 4, 4)`` of the scatter beyond the noise (left column, left row, right column, right row).

        Beside it the scatter ``(N,)`` of the difference of both views, as a share of the noise's variance. Half the
        sum of both views' errors and their difference are independent where both are equally sure. Points that once
        strayed from their field, as at an edge, say nothing of their neighbours any more.
        """
        mine = across @ left.covariance_px2 @ np.swapaxes(across, 1, 2)
        both = mine + right.covariance_px2
        known = (left.valid & right.valid & ~self._stray)[:, None]
        moved, other = (
            self._field.residual_px(np.where(known, view.position_px - start, np.nan))
            for view, start in zip((left, right), self._start, strict=True)
        )
        moved = np.einsum("nij,nj->ni", across, moved)
        alike, strayed = self._field.scatter((moved + other) / 2.0, both / 4.0)
        self._stray |= strayed
        apart, strayed = self._field.scatter(other - moved, both)
        self._stray |= strayed
        each, common = (both * (part / 4.0)[:, None, None] for part in (alike + apart - 2.0, alike - apart))
        back = np.linalg.inv(across)
        whole = np.empty((len(both), 4, 4))
        whole[:, 2:, 2:] = each
        whole[:, 2:, :2] = common @ np.swapaxes(back, 1, 2)
        whole[:, :2, 2:] = np.swapaxes(whole[:, 2:, :2], 1, 2)
        whole[:, :2, :2] = back @ each @ np.swapaxes(back, 1, 2)
        return whole, apart
