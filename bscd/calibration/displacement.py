"""How sure a displacement is: what two positions of a point have in common cancels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration.triangulation import Triangulated


@dataclass(frozen=True, eq=False)
class ImageCovariances:
    """What is known of N points' images in a frame, in px^2; the point is defined by the left reference image.

    ``left_px2`` and ``right_px2`` ``(N, 2, 2)``: of the tracking from the reference frame to this one in the two
    views. ``stereo_px2`` ``(N, 2, 2)``: of the match of the reference's left and right view, which all frames share.
    ``onward`` ``(N, 2, 2)``: deformation gradient of the right view since the reference; it carries the match's error
    on.
    """

    left_px2: FloatArray
    right_px2: FloatArray
    stereo_px2: FloatArray
    onward: FloatArray

    @property
    def position_px2(self) -> FloatArray:
        """Covariance ``(N, 4, 4)`` of (left column, left row, right column, right row) in this frame."""
        whole = np.zeros((len(self.left_px2), 4, 4))
        whole[:, :2, :2] = self.left_px2
        whole[:, 2:, 2:] = self.right_px2 + self.onward @ self.stereo_px2 @ np.swapaxes(self.onward, 1, 2)
        return whole


def displacement_covariance(
    now: Triangulated, reference: Triangulated, images: ImageCovariances, map_difference_px2: FloatArray | None
) -> FloatArray:
    """Covariance ``(N, 3, 3)`` mm^2 of the displacement from ``reference`` to ``now``.

    The tracking's noise counts in full. The stereo match's counts by the difference of its effect in both frames, and
    so does the distortion map's, ``map_difference_px2`` ``(N, 4, 4)`` (`SmoothMap.difference_covariance_px2`; None
    without a map). The reference points' own uncertainty is a rigid motion and a scale, which cancel but for 1e-4 of
    the displacement.
    """
    left, right = now.jacobian[:, :, :2], now.jacobian[:, :, 2:]
    stereo = right @ images.onward - reference.jacobian[:, :, 2:]
    total = left @ images.left_px2 @ np.swapaxes(left, 1, 2)
    total += right @ images.right_px2 @ np.swapaxes(right, 1, 2)
    total += stereo @ images.stereo_px2 @ np.swapaxes(stereo, 1, 2)
    if map_difference_px2 is not None:
        total += now.covariance_mm2(map_difference_px2)
    return total
