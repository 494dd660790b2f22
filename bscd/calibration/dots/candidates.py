"""Candidates: compact dark blobs on a brighter ground, at any size, under any shading.

The black top-hat (closing minus image) takes away shading and every dark area wider than its window; half the
local depth then outlines each blob where its edge is, however weak its contrast.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from bscd.arrays import FloatArray
from bscd.calibration.dots.findings import Image
from bscd.calibration.dots.pixels import eight_bits, noise_level

#: (reduction, window at that reduction): blobs from about 4 to 120 px across.
_SCALES = ((1, 13), (1, 29), (2, 29), (4, 33))
_MIN_AREA = 9
_MIN_DEPTH = 8.0
_MIN_ROUNDNESS = 0.6
_ROUND = 0.88


@dataclass(frozen=True)
class Blobs:
    """Dark blobs.

    ``xy_px`` ``(N, 2)`` centroids; ``shape`` ``(N, 2, 2)`` px^2: the ellipse (x-c)' shape^-1 (x-c) = 1 has the
    blob's second moments; ``area_px`` ``(N,)``; ``roundness`` ``(N,)``: area over that ellipse's, 1 for an
    ellipse, 0.955 for a square, less for ragged blobs; ``depth`` ``(N,)`` below the ground, in 8-bit grey levels.
    """

    xy_px: FloatArray
    shape: FloatArray
    area_px: FloatArray
    roundness: FloatArray
    depth: FloatArray

    def __len__(self) -> int:
        """How many."""
        return len(self.xy_px)

    def keep(self, selection: np.ndarray) -> Blobs:
        """Those at a selection (indices or booleans)."""
        return Blobs(*(v[selection] for v in (self.xy_px, self.shape, self.area_px, self.roundness, self.depth)))


@njit(cache=True)
def _moments(labels, depth, count):
    """Per label: area, sums of x, y, xx, xy, yy and the greatest depth."""
    sums = np.zeros((count, 7))
    for row in range(labels.shape[0]):
        for column in range(labels.shape[1]):
            k = labels[row, column]
            if k == 0:
                continue
            x, y = float(column), float(row)
            s = sums[k]
            s[0] += 1.0
            s[1] += x
            s[2] += y
            s[3] += x * x
            s[4] += x * y
            s[5] += y * y
            if depth[row, column] > s[6]:
                s[6] = depth[row, column]
    return sums


def find_blobs(image: Image) -> Blobs:
    """All compact dark blobs of an image, each once."""
    grey, gain = eight_bits(image)
    least = max(_MIN_DEPTH, 4.0 * noise_level(image) * gain)
    found = []
    reduced, reduction = grey, 1
    for factor, window in _SCALES:
        while reduction < factor:
            reduced, reduction = cv2.resize(reduced, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), reduction * 2
        if min(reduced.shape) <= window:
            continue
        found.append(_blobs_at(reduced, window, least, factor))
    return _merged(found)


def _blobs_at(grey: np.ndarray, window: int, least: float, factor: int) -> Blobs:
    smooth = cv2.GaussianBlur(grey, (3, 3), 0) if factor == 1 else grey
    element = np.ones((window, window), np.uint8)
    ground = cv2.morphologyEx(smooth, cv2.MORPH_CLOSE, element)
    depth = cv2.subtract(ground, smooth)
    local = cv2.dilate(depth, np.ones((window // 2 * 2 + 1,) * 2, np.uint8))
    mask = cv2.compare(depth, np.maximum(local // 2, np.uint8(min(least, 255.0))), cv2.CMP_GT)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4, ltype=cv2.CV_32S)
    sums = _moments(labels, depth, count)
    height, width = grey.shape
    left, top, wide, high = (stats[:, k] for k in range(4))
    whole = (left > 0) & (top > 0) & (left + wide < width) & (top + high < height)
    # a window wider than the blob has to find ground on both sides of it
    keep = whole & (sums[:, 0] >= _MIN_AREA) & (np.minimum(wide, high) < window) & (np.maximum(wide, high) < 4 * window)
    keep[0] = False
    area, sx, sy, sxx, sxy, syy, deepest = sums[keep].T
    x, y = sx / area, sy / area
    # a pixel's own extent adds 1/12 to each second moment
    cov = np.stack([sxx / area - x * x + 1 / 12, sxy / area - x * y, syy / area - y * y + 1 / 12], -1)
    shape = 4.0 * cov[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    round_area = np.pi * np.sqrt(np.maximum(np.linalg.det(shape), 1e-9))
    offset = (factor - 1) / 2.0
    xy = np.stack([x, y], -1) * factor + offset
    return Blobs(xy, shape * factor**2, area * factor**2, area / round_area, deepest)


def _merged(parts: list[Blobs]) -> Blobs:
    """One list: where one lies inside another, the larger is kept, be it round (a dot is no place for another)."""
    every = Blobs(
        *(np.concatenate([getattr(p, n) for p in parts]) for n in ("xy_px", "shape", "area_px", "roundness", "depth"))
    )
    every = every.keep(every.roundness > _MIN_ROUNDNESS)
    order = np.lexsort((-every.area_px, every.roundness < _ROUND))
    return every.keep(np.sort(order[_outermost(every.xy_px[order], np.linalg.inv(every.shape[order]))]))


@njit(cache=True)
def _outermost(xy, inverse):
    """Which points lie outside the ellipses of all earlier ones that were kept."""
    kept = np.empty(len(xy), np.int64)
    count = 0
    for i in range(len(xy)):
        free = True
        for n in range(count):
            j = kept[n]
            x, y = xy[i, 0] - xy[j, 0], xy[i, 1] - xy[j, 1]
            if inverse[j, 0, 0] * x * x + 2.0 * inverse[j, 0, 1] * x * y + inverse[j, 1, 1] * y * y < 1.0:
                free = False
                break
        if free:
            kept[count] = i
            count += 1
    return kept[:count]
