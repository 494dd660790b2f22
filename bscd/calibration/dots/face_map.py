"""A smooth map from a face's lattice to pixels, without any model of the camera.

It predicts where dots are, tells which do not belong, and gives the shift between a projected circle's centre and
the projection of its centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray, IntArray

_DEGREES = ((4, 60), (3, 24), (2, 10), (1, 4))  # degree, dots it needs
_REJECTION_PASSES = 3


@dataclass(frozen=True)
class FaceMap:
    """Polynomials (column, row) of the lattice -> pixel; ``powers`` ``(K, 2)``, ``terms`` ``(K, 2)``.

    The lattice's coordinates are scaled as (value - ``middle``) / ``scale``. ``spread_px`` is a robust standard
    deviation of the fit's residuals per axis.
    """

    powers: np.ndarray
    terms: FloatArray
    middle: FloatArray
    scale: FloatArray
    spread_px: float

    def _design(self, lattice: FloatArray | IntArray, across: int = 0, down: int = 0) -> FloatArray:
        """The monomials' derivatives of order ``across`` by the column and ``down`` by the row."""
        unit = (np.asarray(lattice, np.float64) - self.middle) / self.scale
        design = np.ones((*unit.shape[:-1], len(self.powers)))
        for axis, order in ((0, across), (1, down)):
            power = self.powers[:, axis]
            factor = np.ones(len(power))
            for k in range(order):
                factor = factor * np.maximum(power - k, 0)
            design *= factor * unit[..., axis, None] ** np.maximum(power - order, 0) / self.scale[axis] ** order
        return design

    def pixels(self, lattice: FloatArray | IntArray) -> FloatArray:
        """Pixels ``(..., 2)`` of lattice positions ``(..., 2)`` (column, row)."""
        return self._design(lattice) @ self.terms

    def jacobian(self, lattice: FloatArray | IntArray) -> FloatArray:
        """``(..., 2, 2)`` px per pitch; [..., :, 0] along a row of dots, [..., :, 1] down a column."""
        return np.stack([self._design(lattice, 1, 0) @ self.terms, self._design(lattice, 0, 1) @ self.terms], axis=-1)

    def dot_shape(self, lattice: FloatArray | IntArray, radius: float) -> FloatArray:
        """Ellipses ``(..., 2, 2)`` px^2 (as `Blobs.shape`) of dots whose radius is given in pitches."""
        jacobian = self.jacobian(lattice)
        return radius**2 * jacobian @ np.swapaxes(jacobian, -1, -2)

    def centre_shift(self, lattice: FloatArray | IntArray, radius: float) -> FloatArray:
        """Centre of the dot's image minus image of its centre, ``(..., 2)`` px; radius in pitches.

        To second order the centroid of a disc's image is off by r^2/8 laplacian(q) + r^2/4 J grad(log |det J|).
        """
        jacobian = self.jacobian(lattice)
        second = [self._design(lattice, *order) @ self.terms for order in ((2, 0), (1, 1), (0, 2))]
        inverse = np.linalg.inv(jacobian)
        # d log|det J| = trace(J^-1 dJ)
        slopes = [
            np.einsum("...ij,...ji->...", inverse, np.stack([second[k], second[k + 1]], axis=-1)) for k in range(2)
        ]
        weighted = np.einsum("...ij,...j->...i", jacobian, np.stack(slopes, axis=-1))
        return radius**2 * ((second[0] + second[2]) / 8.0 + weighted / 4.0)


def fit_face_map(lattice: FloatArray | IntArray, xy_px: FloatArray, highest: int = 4) -> FaceMap:
    """Fit the map to dots at ``(N, 2)`` lattice positions (column, row); outliers are left out.

    The degree is what the dots can carry, in all and along either axis, at most ``highest``.
    """
    lattice, xy_px = np.asarray(lattice, np.float64), np.asarray(xy_px, np.float64)
    degree = next((d for d, least in _DEGREES if len(lattice) >= least and d <= highest), 1)
    most = [min(degree, len(np.unique(lattice[:, axis])) - 1) for axis in (0, 1)]
    powers = np.array([(i, j) for i in range(most[0] + 1) for j in range(most[1] + 1) if i + j <= degree])
    low, high = lattice.min(0), lattice.max(0)
    middle, scale = (low + high) / 2.0, np.maximum((high - low) / 2.0, 1.0)
    frame = FaceMap(powers, np.zeros((len(powers), 2)), middle, scale, 0.0)
    design = frame._design(lattice)
    used = np.ones(len(lattice), bool)
    terms, spread = _solved(design, xy_px, used)
    for _ in range(_REJECTION_PASSES):
        miss = np.linalg.norm(xy_px - design @ terms, axis=1)
        better = miss < max(6.0 * spread, 1e-6)
        if (better == used).all() or better.sum() < 2 * len(powers):
            break
        used = better
        terms, spread = _solved(design, xy_px, used)
    return FaceMap(powers, terms, middle, scale, spread)


def _solved(design: FloatArray, xy_px: FloatArray, used: np.ndarray) -> tuple[FloatArray, float]:
    part, seen = design[used], xy_px[used]
    # monomials on [-1, 1] up to the fourth degree: the normal equations lose nothing that matters, and are fast
    terms = np.linalg.lstsq(part.T @ part, part.T @ seen, rcond=1e-13)[0]
    miss = np.linalg.norm(seen - part @ terms, axis=1)
    return terms, float(np.median(miss) / 1.1774)  # the median of a Rayleigh distribution is 1.1774 sigma
