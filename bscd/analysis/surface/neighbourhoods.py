"""Which measured points a strain window holds, and the polynomial fits over them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from bscd.analysis.surface.derivative_kernel import (
    WEIGHTS,
    apply_rows,
    fit_rows,
    mean_rows,
    noise_rows,
    square_rows,
    terms_of,
)
from bscd.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class LocalFits:
    """Polynomial fits about ``rows`` ``(M,)``: weights in ``table``, from ``start`` ``(M,)``, -1 where there is none.

    ``count`` ``(M,)`` is the number of neighbours in a fit, ``offset`` ``(M,)`` how far their centre is off the point,
    as a part of the window's half width, along columns or rows, whichever is more. ``normals`` ``(N, T, T)`` are the
    rows' normal matrices.
    """

    rows: IntArray
    table: FloatArray
    start: IntArray
    count: IntArray
    offset: FloatArray
    normals: FloatArray

    def only(self, keep: BoolArray) -> LocalFits:
        """The fits of some rows, by a mask ``(M,)``."""
        return LocalFits(
            self.rows[keep], self.table, self.start[keep], self.count[keep], self.offset[keep], self.normals
        )


@dataclass(frozen=True)
class Neighbourhoods:
    """The square windows of ``2 half_px`` about points ``(N, 2)`` px, neighbours of i at indptr[i] .. indptr[i + 1]."""

    points_px: FloatArray
    half_px: float
    indptr: IntArray
    indices: IntArray

    @classmethod
    def of(cls, points_px: FloatArray, half_px: float) -> Neighbourhoods:
        """The neighbours, in order of their index, a point being its own."""
        reach = half_px * (1.0 + 1e-6)
        found = KDTree(points_px).query_ball_point(points_px, reach, p=np.inf, return_sorted=True)
        sizes = np.array([len(neighbours) for neighbours in found], dtype=np.int64)
        return cls(points_px, half_px, np.append(0, np.cumsum(sizes)), np.concatenate(found).astype(np.int64))

    def touched_by(self, points: IntArray) -> BoolArray:
        """Mask ``(N,)`` of the points that have one of the given points in their window."""
        touched = np.zeros(len(self.points_px), dtype=bool)
        for point in points:
            touched[self.indices[self.indptr[point] : self.indptr[point + 1]]] = True
        return touched

    def fit(
        self, rows: IntArray, valid: BoolArray, order: int, depth_order: int, complete: LocalFits | None = None
    ) -> LocalFits:
        """Fit polynomials of both orders about rows ``(M,)`` to their neighbours that are valid ``(N,)``.

        With the ``complete`` fits about these rows, of when all points were valid, it takes a third of the time.
        """
        terms = terms_of(max(order, depth_order))
        normals = np.zeros((len(self.points_px), terms, terms)) if complete is None else complete.normals
        found = fit_rows(
            self.points_px,
            self.indptr,
            self.indices,
            valid,
            rows,
            self.half_px,
            int(order),
            int(depth_order),
            normals,
            complete is None,
        )
        return LocalFits(rows, *found, normals)

    def derivatives(self, fits: LocalFits, values: FloatArray, out: FloatArray) -> None:
        """Derivatives by column and row, of both orders, of finite values ``(N, 3)`` into ``out`` ``(N, 3, 4)``."""
        apply_rows(values, self.indptr, self.indices, fits.rows, fits.table, fits.start, out)

    def local_mean(self, fits: LocalFits, values: FloatArray, out: FloatArray) -> None:
        """Means of finite values ``(N, 3)`` over the fits, into ``out`` ``(N, 3)``."""
        mean_rows(values, self.indptr, self.indices, fits.rows, fits.table, fits.start, out)

    def squares(self, fits: LocalFits) -> FloatArray:
        """Variance ``(N, 4)`` of the derivatives for independent unit noise; NaN elsewhere."""
        out = np.full((len(self.points_px), WEIGHTS), np.nan)
        square_rows(self.indptr, fits.rows, fits.table, fits.start, out)
        return out

    def noise(self, fits: LocalFits, subset_px: float) -> FloatArray:
        """Covariance ``(N, 4, 4)`` of the derivatives for unit noise that overlapping subsets share; NaN elsewhere."""
        out = np.full((len(self.points_px), WEIGHTS, WEIGHTS), np.nan)
        noise_rows(self.points_px, self.indptr, self.indices, fits.rows, fits.table, fits.start, subset_px, out)
        return out
