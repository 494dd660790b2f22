"""How sure a displacement is: what two positions of a point have in common cancels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration.triangulation import Triangulated


@dataclass(frozen=True, eq=False)
class ImageCovariances:
    """What is known of N points' images in a frame, in px^2; the point is defined by the left reference image.

    ``tracking_px2`` ``(N, 4, 4)``: of the tracking from the reference frame to this one, as (left column, left row,
    right column, right row). ``stereo_px2`` ``(N, 2, 2)``: of the match of the reference's left and right view, which
    all frames share. ``onward`` ``(N, 2, 2)``: deformation gradient of the right view since the reference; it carries
    the match's error on. ``position_px2`` ``(N, 4, 4)``: of both images' places in this frame.
    """

    tracking_px2: FloatArray
    stereo_px2: FloatArray
    onward: FloatArray
    position_px2: FloatArray


def displacement_covariance(
    now: Triangulated, reference: Triangulated, images: ImageCovariances, map_difference_px2: FloatArray | None
) -> FloatArray:
    """Covariance ``(N, 3, 3)`` mm^2 of the displacement from ``reference`` to ``now``.

    The tracking's noise counts in full. The stereo match's counts by the difference of its effect in both frames, and
    so does the distortion map's, ``map_difference_px2`` ``(N, 4, 4)`` (`SmoothMap.difference_covariance_px2`; None
    without a map). The reference points' own uncertainty is a rigid motion and a scale, which cancel but for 1e-4 of
    the displacement.
    """
    stereo = now.jacobian[:, :, 2:] @ images.onward - reference.jacobian[:, :, 2:]
    total = now.covariance_mm2(images.tracking_px2)
    total += stereo @ images.stereo_px2 @ np.swapaxes(stereo, 1, 2)
    if map_difference_px2 is not None:
        total += now.covariance_mm2(map_difference_px2)
    return total
