"""What subsets of an image say of their displacement: sums over them, their Hessian, the sigma to expect."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.dic.noise import Image, ImageNoise, saturated

FloatImage = NDArray[np.float32]

#: Derivative of sixth order: 2 % low for waves of 5 px, exact for longer ones.
_DERIVATIVE = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0], np.float32) / np.float32(60.0)
_NOISE_GAIN = float(np.sum(_DERIVATIVE.astype(np.float64) ** 2))
_ROUNDING = 1e-6  # of a sum of squares
_TEXTURE = 0.3  # of what noise alone gives, by which texture must exceed it
_ALONG = 0.1  # the component of a direction along an axis that counts
_BAND_ROWS = 96  # of centres, measured at a time: what is read again stays in the processor's cache
_THREADS = 4  # at most
#: Elements of the Hessian that are sums of the same: u_y v_x and u_x v_y, and so on.
_SAME = {(3, 4): (2, 5), (4, 6): (2, 7), (5, 6): (3, 7)}


@dataclass(frozen=True, eq=False)
class SubsetFigures:
    """Figures ``(N,)`` of N subsets: see `SpeckleQuality`; ``sssig_grey2`` and ``sigma_px`` are ``(N, 2)``."""

    mig_grey: FloatArray
    sssig_grey2: FloatArray
    sigma_px: FloatArray
    noise_grey: FloatArray
    saturated_share: FloatArray
    pixels: FloatArray


def measure_subsets(
    image: Image, mask: BoolArray | None, centre_px: IntArray, half_px: int, noise: float | ImageNoise
) -> SubsetFigures:
    """Figures of the subsets round unmasked pixels ``centre_px (N, 2)`` of a checked image, ``half_px`` to each side.

    ``noise`` is the standard deviation of the noise of one image in grey levels, or its description.
    """
    fields = _Fields.of(image, mask)
    values = np.empty((8, len(centre_px)))
    band = centre_px[:, 1] // _BAND_ROWS
    order = np.argsort(band, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(band[order])) + 1) if len(order) else []

    def measure(part: IntArray) -> None:
        values[:, part] = _measure_part(fields, centre_px[part], half_px, noise)

    with ThreadPoolExecutor(min(_THREADS, len(os.sched_getaffinity(0))), thread_name_prefix="speckle") as pool:
        for _ in pool.map(measure, parts):
            pass
    mig, sssig_x, sssig_y, sigma_x, sigma_y, level_noise, clipped, pixels = values
    return SubsetFigures(
        mig, np.stack([sssig_x, sssig_y], -1), np.stack([sigma_x, sigma_y], -1), level_noise, clipped, pixels
    )


@dataclass(frozen=True, eq=False)
class _Fields:
    """The image less ``mean``, its gradients by column and row, 0 where masked; what counts and what is saturated.

    ``resolution_grey`` is what rounding leaves of the grey levels.
    """

    mean: float
    resolution_grey: float
    grey: FloatImage
    gradient: tuple[FloatImage, FloatImage]
    counted: FloatImage | None
    saturated: NDArray[np.uint8] | None

    @classmethod
    def of(cls, image: Image, mask: BoolArray | None) -> _Fields:
        one, border = np.ones(1, np.float32), cv2.BORDER_REFLECT_101
        along_x = np.asarray(cv2.sepFilter2D(image, cv2.CV_32F, _DERIVATIVE, one, borderType=border), np.float32)
        along_y = np.asarray(cv2.sepFilter2D(image, cv2.CV_32F, one, _DERIVATIVE, borderType=border), np.float32)
        grey = image.astype(np.float32)
        mean = float(grey.mean(dtype=np.float64))
        resolution = float(np.finfo(np.float32).eps) * cv2.norm(grey, cv2.NORM_INF)
        grey -= np.float32(mean)
        counted = None
        if mask is not None:
            counted = mask.astype(np.float32)
            for field in (grey, along_x, along_y):
                field *= counted
        clipped = saturated(image)
        if clipped is not None:
            clipped = (clipped if mask is None else clipped & mask).view(np.uint8)
        return cls(mean, resolution, grey, (along_x, along_y), counted, clipped)


class _SubsetSums:
    """Sums over the subsets of N points, by integral images of the part of the image that they cover.

    ``columns`` ``(1, w)`` and ``rows`` ``(h, 1)`` are the part's pixels, counted from its middle, where offsets lose
    the fewest digits; ``x`` and ``y`` ``(N,)`` the subsets' centres, counted likewise.
    """

    def __init__(self, centre: IntArray, half: int, shape: tuple[int, ...]) -> None:
        x, y = np.ascontiguousarray(centre.T)
        left, right = np.maximum(x - half, 0), np.minimum(x + half + 1, shape[1])
        top, bottom = np.maximum(y - half, 0), np.minimum(y + half + 1, shape[0])
        first, last, highest, lowest = (int(n) for n in (left.min(), right.max(), top.min(), bottom.max()))
        self.part = slice(highest, lowest), slice(first, last)
        self.area = ((right - left) * (bottom - top)).astype(np.float64)
        height, width = lowest - highest, last - first
        self._corners = [
            (row - highest) * (width + 1) + column - first
            for row, column in ((bottom, right), (top, right), (bottom, left), (top, left))
        ]
        self._tables = np.empty((2, height + 1, width + 1))
        self._product = np.empty((height, width), np.float32)
        middle = (first + last - 1) / 2.0, (highest + lowest - 1) / 2.0
        self.columns = (np.arange(first, last) - middle[0]).astype(np.float32)[None, :]
        self.rows = (np.arange(highest, lowest) - middle[1]).astype(np.float32)[:, None]
        self.x, self.y = x - middle[0], y - middle[1]

    def total(self, field: FloatImage | NDArray[np.uint8]) -> FloatArray:
        """Sums ``(N,)`` of a field on the part."""
        return self._over_subsets(cv2.integral(field, self._tables[0], cv2.CV_64F))

    def total_product(self, one: FloatImage, other: FloatImage) -> FloatArray:
        """Sums ``(N,)`` of the product of two fields on the part."""
        return self.total(np.multiply(one, other, out=self._product))

    def totals(self, field: FloatImage) -> tuple[FloatArray, FloatArray]:
        """Sums ``(N,)`` of a field and of its squares; both cost hardly more than one."""
        plain, squares = cv2.integral2(field, self._tables[0], self._tables[1], cv2.CV_64F, cv2.CV_64F)
        return self._over_subsets(plain), self._over_subsets(squares)

    def _over_subsets(self, table: NDArray[np.generic]) -> FloatArray:
        a, b, c, d = (table.ravel().take(corner) for corner in self._corners)
        return a - b - c + d


def _hessian(sums: _SubsetSums, grey: FloatImage, along_x: FloatImage, along_y: FloatImage) -> FloatArray:
    """``(8, 8, N)`` of offset, gain, displacement gradients (u_x, u_y, v_x, v_y) and u, v; the upper half only."""
    gradients = [g * offset for g in (along_x, along_y) for offset in (sums.columns, sums.rows)]
    change = [grey, *gradients, along_x, along_y]
    hessian = np.empty((8, 8, len(sums.x)))
    for k, one in enumerate(change, start=1):
        hessian[0, k], hessian[k, k] = sums.totals(one)
    for (k, one), (m, other) in combinations(enumerate(change, start=1), 2):
        if (k, m) not in _SAME:
            hessian[k, m] = sums.total_product(one, other)
    for pair, twin in _SAME.items():
        hessian[pair] = hessian[twin]
    # offsets from each subset's centre instead of the part's middle
    for k, m, by in ((2, 6, sums.x), (3, 6, sums.y), (4, 7, sums.x), (5, 7, sums.y)):
        hessian[k, k] -= by * (2.0 * hessian[k, m] - by * hessian[m, m])
        hessian[:k, k] -= by * hessian[:k, m]
        for j in range(k + 1, 8):
            hessian[k, j] -= by * hessian[min(j, m), max(j, m)]
    return hessian


def _measure_part(fields: _Fields, centre: IntArray, half: int, noise: float | ImageNoise) -> FloatArray:
    """MIG, SSSIG (2), sigma (2), noise, saturated share and pixels ``(8, N)`` of subsets round ``centre (N, 2)``."""
    sums = _SubsetSums(centre, half, fields.grey.shape)
    grey, along_x, along_y = (field[sums.part] for field in (fields.grey, *fields.gradient))
    hessian = _hessian(sums, grey, along_x, along_y)
    pixels = sums.area if fields.counted is None else sums.total(fields.counted[sums.part])
    hessian[0, 0] = pixels
    level = fields.mean + hessian[0, 1] / pixels
    variance = noise.variance_at(level) if isinstance(noise, ImageNoise) else np.full_like(level, float(noise) ** 2)
    from_noise = _NOISE_GAIN * (variance + fields.resolution_grey**2) * pixels
    steepness = np.sqrt(along_x * along_x + along_y * along_y)
    clipped = 0.0 * pixels if fields.saturated is None else sums.total(fields.saturated[sums.part])
    sssig_x, sssig_y = hessian[6, 6].copy(), hessian[7, 7].copy()
    sigma_u, sigma_v = _expected_sigma(hessian, variance, from_noise)
    mig = sums.total(steepness) / pixels
    return np.stack([mig, sssig_x, sssig_y, sigma_u, sigma_v, np.sqrt(variance), clipped / pixels, pixels])


def _expected_sigma(hessian: FloatArray, variance: FloatArray, from_noise: FloatArray) -> FloatArray:
    """Sigma of u and v ``(2, N)`` from Hessians ``(8, 8, N)`` and the noise's ``variance (N,)``.

    ``from_noise`` ``(N,)`` is what noise alone adds to the Hessian's elements of u and v. Of the two directions that
    are known independently, one without texture above that makes each axis unknown that it is not across to.
    The Hessians are used up.
    """
    scale = hessian[6, 6] + hessian[7, 7]
    uu, uv, vv = _translation_information(hessian)
    middle, away = (uu + vv) / 2.0 - from_noise, np.hypot((uu - vv) / 2.0, uv)
    turned = np.divide((uu - vv) / 2.0, away, out=np.ones_like(away), where=away > 0.0)
    along = np.stack([1.0 + turned, 1.0 - turned]) / 2.0
    least = np.maximum(_TEXTURE * from_noise, _ROUNDING * scale)
    spread, unknown = np.zeros((2, len(variance))), np.zeros((2, len(variance)), bool)
    for known, part in ((middle + away, along), (middle - away, along[::-1])):
        unknown |= ~(known > least) & (part > _ALONG**2)
        spread += part / np.maximum(known, np.maximum(least, 1e-30))
    return np.where(unknown, np.inf, np.sqrt(2.0 * variance * spread))


def _translation_information(hessian: FloatArray) -> FloatArray:
    """What Hessians ``(8, 8, N)`` say of u and v if all else is free: the elements uu, uv, vv ``(3, N)``.

    Schur's complement, one parameter at a time, in place; a parameter that the subset can not tell takes nothing
    away. Only the upper half is looked at.
    """
    least = [_ROUNDING * hessian[k, k] for k in range(6)]
    for k in range(6):
        pivot = hessian[k, k]
        share = np.divide(1.0, pivot, out=np.zeros_like(pivot), where=pivot > least[k])
        for i in range(k + 1, 8):
            hessian[i, i:] -= share * hessian[k, i] * hessian[k, i:]
    return np.stack([hessian[6, 6], hessian[6, 7], hessian[7, 7]])
