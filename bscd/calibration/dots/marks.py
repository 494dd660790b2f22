"""Dark marks of any compact shape (squares, discs, also on curved bodies): grey-weighted centroids."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from bscd.calibration.dots.candidates import find_blobs
from bscd.calibration.dots.findings import Image, Marks
from bscd.calibration.dots.pixels import checked, noise_level

_COMPACT = 0.85  # of the area of the ellipse with the same second moments: 0.955 for a square, 1 for a disc
_CORE, _RIM = 1.5, 2.0  # of that ellipse: what surely holds the mark; what its ground is taken from
_FEWEST_GROUND = 12
_FLOOR_SIGMA_PX = 0.02  # the printed shape, pixel sampling


def find_marks(image: Image, *, size_px: tuple[float, float] | None = None, contrast: float = 0.0) -> Marks:
    """Find dark marks on a brighter ground; background clutter that looks like marks comes with them.

    Parameters
    ----------
    image
        ``(H, W)``, uint8, uint16 or float.
    size_px
        Least and greatest square root of a mark's area; any by default.
    contrast
        Least depth below the ground in grey levels of this image.
    """
    image = checked(image)
    blobs = find_blobs(image)
    keep = blobs.roundness > _COMPACT
    if size_px is not None:
        side = np.sqrt(blobs.area_px)
        keep &= (side >= size_px[0]) & (side <= size_px[1])
    blobs = blobs.keep(keep)
    out = np.full((len(blobs), 5), np.nan)
    _measure(image, blobs.xy_px, np.linalg.inv(blobs.shape), out)
    good = np.isfinite(out).all(axis=1) & (out[:, 3] > contrast)
    centre, area, depth, lever = out[good, :2], out[good, 2], out[good, 3], out[good, 4]
    sigma = np.hypot(noise_level(image) * lever, _FLOOR_SIGMA_PX)
    return Marks(centre, sigma, area, depth)


@njit(cache=True)
def _measure(image, xy, inverse, out):
    """Per mark: centroid (2), area, depth, and the centroid's standard deviation per unit of pixel noise."""
    for i in range(len(xy)):
        _measure_one(image, xy[i, 0], xy[i, 1], inverse[i], out[i])


@njit(cache=True)
def _measure_one(image, x0, y0, inverse, out):
    a, b, c = inverse[0, 0], inverse[0, 1], inverse[1, 1]
    det = a * c - b * b
    wide, high = _RIM * math.sqrt(c / det), _RIM * math.sqrt(a / det)
    top, bottom = max(math.ceil(y0 - high), 0), min(math.floor(y0 + high), image.shape[0] - 1)
    left, right = max(math.ceil(x0 - wide), 0), min(math.floor(x0 + wide), image.shape[1] - 1)
    # halfway between the mark's middle and the brighter half of its surroundings
    inner, inner_count, outer, outer_count = 0.0, 0, 0.0, 0
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            x, y = column - x0, row - y0
            q = a * x * x + 2.0 * b * x * y + c * y * y
            if q < 0.25:
                inner += image[row, column]
                inner_count += 1
            elif _CORE * _CORE < q < _RIM * _RIM:
                outer += image[row, column]
                outer_count += 1
    if inner_count == 0 or outer_count < _FEWEST_GROUND:
        return
    level = 0.5 * (inner / inner_count + outer / outer_count)
    ground, sx, sy = _ground_plane(image, x0, y0, a, b, c, level, top, bottom, left, right)
    depth = ground - inner / inner_count
    if not depth > 0.0:
        return
    total, mx, my, xx, area = 0.0, 0.0, 0.0, 0.0, 0
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            x, y = column - x0, row - y0
            if a * x * x + 2.0 * b * x * y + c * y * y > _CORE * _CORE:
                continue
            weight = ground + sx * x + sy * y - image[row, column]
            if weight > 0.5 * depth:
                area += 1
            if weight > 0.1 * depth:
                total += weight
                mx += weight * x
                my += weight * y
                xx += 0.5 * (x * x + y * y)
    if total > 0.0:
        out[0], out[1], out[2], out[3] = x0 + mx / total, y0 + my / total, area, depth
        out[4] = math.sqrt(xx) / total


@njit(cache=True)
def _ground_plane(image, x0, y0, a, b, c, level, top, bottom, left, right):
    """The plane through the bright pixels round a mark: its value and slopes at the mark; NaN if there are few."""
    n = np.zeros((3, 3))
    g = np.zeros(3)
    count = 0
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            x, y = column - x0, row - y0
            q = a * x * x + 2.0 * b * x * y + c * y * y
            if q <= _CORE * _CORE or q >= _RIM * _RIM or image[row, column] < level:
                continue
            value = float(image[row, column])
            n[0, 0] += 1.0
            n[0, 1] += x
            n[0, 2] += y
            n[1, 1] += x * x
            n[1, 2] += x * y
            n[2, 2] += y * y
            g[0] += value
            g[1] += x * value
            g[2] += y * value
            count += 1
    if count < _FEWEST_GROUND:
        return np.nan, 0.0, 0.0
    n[1, 0], n[2, 0], n[2, 1] = n[0, 1], n[0, 2], n[1, 2]
    if abs(np.linalg.det(n)) < 1e-6:
        return np.nan, 0.0, 0.0
    plane = np.linalg.solve(n, g)
    return plane[0], plane[1], plane[2]
