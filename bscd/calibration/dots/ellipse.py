"""Sub-pixel centres: least squares of a blurred ellipse under a plane of illumination.

Model: I = (b0 + b1 x + b2 y)(1 - c E), with E = Phi(d / w): d the distance inside the ellipse's rim, w the edge's
width (lens blur and pixel together). The plane matters: a slope of 1 % over 10 px moves a plain centroid by
0.02 px. The window is an ellipse about the dot, so whatever the model lacks evenly on both sides cancels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration.dots.ellipse_kernel import CENTROID_SIGMA_PX, fit_all
from bscd.calibration.dots.findings import Image
from bscd.calibration.dots.pixels import full_scale

__all__ = ["CENTROID_SIGMA_PX", "EllipseFits", "fit_ellipses"]


@dataclass(frozen=True)
class EllipseFits:
    """Fitted dots.

    ``xy_px`` ``(N, 2)`` ellipse centres; ``sigma_px`` ``(N,)``; ``shape`` ``(N, 2, 2)`` as in `Blobs`; ``width_px``
    ``(N,)`` of the edge; ``ground``, ``contrast`` ``(N,)``: grey level around the dot, share of it missing inside;
    ``residual`` ``(N,)`` rms in grey levels; ``seen`` ``(N,)`` share of the dot's window inside the view;
    ``fitted`` ``(N,)``: False where only the grey-weighted centroid could be had; ``saturated`` ``(N,)`` share of
    the window's pixels at full scale.
    """

    xy_px: FloatArray
    sigma_px: FloatArray
    shape: FloatArray
    width_px: FloatArray
    ground: FloatArray
    contrast: FloatArray
    residual: FloatArray
    seen: FloatArray
    fitted: np.ndarray
    saturated: FloatArray

    def __len__(self) -> int:
        """How many."""
        return len(self.xy_px)

    def keep(self, selection: np.ndarray) -> EllipseFits:
        """Those at a selection (indices or booleans)."""
        return EllipseFits(*(getattr(self, name)[selection] for name in self.__dataclass_fields__))

    def replaced(self, where: np.ndarray, better: EllipseFits) -> EllipseFits:
        """These with the fits at some indices replaced."""
        names = self.__dataclass_fields__
        parts = {name: getattr(self, name).copy() for name in names}
        for name in names:
            parts[name][where] = getattr(better, name)
        return EllipseFits(**parts)

    def joined(self, other: EllipseFits) -> EllipseFits:
        """These and the others."""
        names = self.__dataclass_fields__
        return EllipseFits(*(np.concatenate([getattr(self, n), getattr(other, n)]) for n in names))


def fit_ellipses(
    image: Image, xy_px: FloatArray, shape: FloatArray, limits_px: FloatArray, reach: float = 2.0
) -> EllipseFits:
    """Fit dots.

    Parameters
    ----------
    image
        uint8, uint16 or float32 ``(H, W)``.
    xy_px, shape
        Where to start: centres ``(N, 2)`` and ellipses ``(N, 2, 2)`` px^2 as in `Blobs`.
    limits_px
        ``(H, 2)``: the first and last column of each row that belong to the view.
    reach
        How far the window may go, in the dot's own radii, so that it meets no other dot.
    """
    count = len(xy_px)
    out = np.full((count, 13), np.nan)
    fit_all(
        image, np.ascontiguousarray(xy_px, np.float64), np.ascontiguousarray(shape, np.float64),
        np.ascontiguousarray(limits_px, np.float64), reach, full_scale(image), out,
    )  # fmt: skip
    covariance = out[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
    return EllipseFits(
        xy_px=out[:, :2], sigma_px=out[:, 5], shape=covariance, width_px=out[:, 6], ground=out[:, 7],
        contrast=out[:, 8], residual=out[:, 9], seen=out[:, 10], fitted=out[:, 11] > 0, saturated=out[:, 12],
    )  # fmt: skip
