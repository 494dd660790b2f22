"""What is known of a point's two images in a frame: noise, what left and right share of it, and the field's scatter."""

from __future__ import annotations

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration import ImageCovariances
from bscd.dic import Correlation
from bscd.dic.curvature import Curvature
from bscd.dic.tracking import Tracked


def reference_covariances(stereo: Correlation) -> ImageCovariances:
    """Of the reference frame itself: the left image defines the point, the stereo match places the right one."""
    count = len(stereo.status)
    position = np.zeros((count, 4, 4))
    position[:, 2:, 2:] = stereo.covariance_px2
    return ImageCovariances(np.zeros((count, 4, 4)), stereo.covariance_px2, np.tile(np.eye(2), (count, 1, 1)), position)


def frame_covariances(
    left: Tracked, right: Tracked, stereo: Correlation, left_px: FloatArray, right_px: FloatArray, field: Curvature
) -> ImageCovariances:
    """Of a tracked frame; ``left_px`` and ``right_px`` ``(N, 2)`` are the points in the reference's views.

    The right reference's noise moves the stereo match and the tracking that starts from it in opposite ways, so it is
    not in the position; the left reference's moves both views' positions alike. What scatters about the smooth field
    beyond the noise (`Curvature.scatter`) is added, as far as both views have it in common or apart.
    """
    onward = np.eye(2) + right.gradient
    seen = np.eye(2) + stereo.gradient
    # how the left view's place in this frame maps to the right view's
    across = onward @ seen @ np.linalg.inv(np.eye(2) + left.gradient)
    excess, apart = _excess(left, right, left_px, right_px, across, field)
    tracking = excess.copy()
    tracking[:, :2, :2] += left.covariance_px2
    tracking[:, 2:, 2:] += right.covariance_px2
    position = excess
    shared = across @ left.reference_px2
    position[:, :2, :2] += left.covariance_px2
    position[:, 2:, :2] += shared
    position[:, :2, 2:] += np.swapaxes(shared, 1, 2)
    position[:, 2:, 2:] += shared @ np.swapaxes(across, 1, 2) + right.covariance_px2 - right.reference_px2
    # of the stereo match so much is what the tracking has too, scatter included; what it has more is its own
    same = shared @ np.swapaxes(across, 1, 2) + right.reference_px2
    own = onward @ stereo.covariance_px2 @ np.swapaxes(onward, 1, 2)
    times = np.trace(np.linalg.solve(same, own), axis1=1, axis2=2) / 2.0
    position[:, 2:, 2:] += np.maximum(times / apart - 1.0, 0.0)[:, None, None] * same
    return ImageCovariances(tracking, stereo.covariance_px2, onward, position)


def _excess(
    left: Tracked,
    right: Tracked,
    left_px: FloatArray,
    right_px: FloatArray,
    across: FloatArray,
    field: Curvature,
) -> tuple[FloatArray, FloatArray]:
    """Covariance ``(N, 4, 4)`` of the scatter beyond the noise, as (left column, left row, right column, right row).

    Beside it the scatter ``(N,)`` of the difference of both views, as a share of the noise's variance. Half the sum of
    both views' errors and their difference are independent where both are equally sure.
    """
    to_right = np.swapaxes(across, 1, 2)
    mine = across @ left.covariance_px2 @ to_right
    both = mine + right.covariance_px2
    both_known = (left.valid & right.valid)[:, None]
    moved, other = (
        field.residual_px(np.where(both_known, view.position_px - start, np.nan))
        for view, start in ((left, left_px), (right, right_px))
    )
    moved = np.einsum("nij,nj->ni", across, moved)
    alike = field.scatter((moved + other) / 2.0, both / 4.0)
    apart = field.scatter(other - moved, both)
    each, common = (both * (part / 4.0)[:, None, None] for part in (alike + apart - 2.0, alike - apart))
    back = np.linalg.inv(across)
    whole = np.empty((len(both), 4, 4))
    whole[:, 2:, 2:] = each
    whole[:, 2:, :2] = common @ np.swapaxes(back, 1, 2)
    whole[:, :2, 2:] = np.swapaxes(whole[:, 2:, :2], 1, 2)
    whole[:, :2, :2] = back @ each @ np.swapaxes(back, 1, 2)
    return whole, apart
