"""The two pairs of views that can be measured with: the biprism's halves, and primary beside auxiliary camera."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration import (
    Calibration,
    ImageCovariances,
    Located,
    Points3D,
    displacement_covariance,
    epipolar_curve,
    triangulate,
)
from bscd.errors import InputError

#: Depths of an epipolar curve: fine enough for a straight line between them.
_DEPTHS = 81
_BEYOND_MM = 1.0


class PairGeometry(Protocol):
    """What the sequence needs of a pair of calibrated views."""

    def curve(self, left_px: FloatArray) -> FloatArray:
        """Where points ``(n, 2)`` of the left view may be in the right view, ``(n, K, 2)`` px."""
        ...

    def locate(self, left_px: FloatArray, right_px: FloatArray) -> Located:
        """Triangulate points ``(N, 2)`` each."""
        ...

    def describe(self, located: Located, covariance_px2: FloatArray) -> Points3D:
        """Points with their uncertainty for image covariances ``(N, 4, 4)``."""
        ...

    def displacement_sigma_mm(self, now: Located, reference: Located, images: ImageCovariances) -> FloatArray:
        """Uncertainty ``(N, 3)`` of displacements."""
        ...


def depths_mm(calibration: Calibration) -> FloatArray:
    """The depths that a surface may have: those of the calibrated volume."""
    y = calibration.control.reference_mm[:, 1]
    return np.linspace(y.min() - _BEYOND_MM, y.max() + _BEYOND_MM, _DEPTHS)


class BiprismGeometry:
    """The two virtual cameras with their distortion maps."""

    def __init__(self, calibration: Calibration, corrected: bool, extrapolate: bool) -> None:
        self._calibration = calibration
        self._corrected, self._extrapolate = corrected, extrapolate
        self._depths = depths_mm(calibration)

    def curve(self, left_px: FloatArray) -> FloatArray:
        """Where points may be in the right view."""
        return epipolar_curve(self._calibration.left.matrix, self._calibration.right.matrix, left_px, self._depths)

    def locate(self, left_px: FloatArray, right_px: FloatArray) -> Located:
        """Triangulate, corrected where that was asked for."""
        return self._calibration.locate(left_px, right_px, self._corrected, extrapolate=self._extrapolate)

    def describe(self, located: Located, covariance_px2: FloatArray) -> Points3D:
        """Points with their uncertainty."""
        return self._calibration.describe(located, covariance_px2)

    def displacement_sigma_mm(self, now: Located, reference: Located, images: ImageCovariances) -> FloatArray:
        """Uncertainty of displacements."""
        return self._calibration.displacement_sigma_mm(now, reference, images)


class StandardGeometry:
    """The primary camera without the biprism (left) and the auxiliary camera (right), their lenses corrected."""

    def __init__(self, calibration: Calibration) -> None:
        names = ("primary", "auxiliary")
        if set(calibration.lenses) < set(names):
            raise InputError("calibration: it holds no standard stereo pair; calibrate from a reference scan")
        self._calibration = calibration
        self._lenses = [calibration.lenses[name] for name in names]
        self._matrices = [lens.pinhole for lens in self._lenses]
        self._depths = depths_mm(calibration)

    def curve(self, left_px: FloatArray) -> FloatArray:
        """Where points of the primary camera may be in the auxiliary camera."""
        primary, auxiliary = self._lenses
        ideal = primary.ideal_px(left_px)
        return auxiliary.distorted_px(epipolar_curve(self._matrices[0], self._matrices[1], ideal, self._depths))

    def locate(self, left_px: FloatArray, right_px: FloatArray) -> Located:
        """Triangulate with the two cameras."""
        ideal = [lens.ideal_px(seen) for lens, seen in zip(self._lenses, (left_px, right_px), strict=True)]
        points = triangulate(self._matrices, ideal, self._calibration.choices.triangulation)
        return Located(points, points.xyz_mm, self._calibration.hull.contains(points.xyz_mm), corrected=False)

    def describe(self, located: Located, covariance_px2: FloatArray) -> Points3D:
        """Points with their uncertainty."""
        return self._calibration.describe(located, covariance_px2)

    def displacement_sigma_mm(self, now: Located, reference: Located, images: ImageCovariances) -> FloatArray:
        """Uncertainty of displacements."""
        covariance = displacement_covariance(now.points, reference.points, images, None)
        return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
