"""Initial guesses for large motion and rotation: matched features (Lowe 2004, SIFT)."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bscd.arrays import BoolArray, FloatArray
from bscd.dic.guess.grey import eight_bit
from bscd.dic.images import PreparedImage

#: So many of the strongest features are looked for in each image, if not told otherwise.
_FEATURES = 4000

#: Lowe's ratio: a match counts when the second best is this much farther away.
_RATIO = 0.8

#: Features of reference images by their number, for they are asked for again and again; they go with their image.
_known: WeakKeyDictionary[PreparedImage, dict[int, tuple[FloatArray, NDArray[np.float32]]]] = WeakKeyDictionary()

#: Matches about a point that a local affine map is fitted to, and how far one may be from its neighbours' map.
_NEIGHBOURS = 12
_CONSISTENT_PX = 6.0


class FeatureMatches:
    """Consistent matches of features between a reference and a current image."""

    def __init__(self, reference: PreparedImage, current: PreparedImage, most: int = _FEATURES) -> None:
        self._places, self._moved = _matches(reference, current, most)
        for _ in range(2):  # the second pass with neighbourhoods that the first has cleaned
            if len(self._places) > _NEIGHBOURS:
                kept = _consistent(self._places, self._moved)
                self._places, self._moved = self._places[kept], self._moved[kept]

    def at(self, points_px: FloatArray) -> FloatArray:
        """Affine guesses ``(N, 6)`` at points ``(N, 2)`` from the nearest matches; NaN when there are too few."""
        if len(self._places) <= _NEIGHBOURS:
            return np.full((len(points_px), 6), np.nan)
        return _local_affine(self._places, self._moved, points_px)


def _matches(reference: PreparedImage, current: PreparedImage, most: int) -> tuple[FloatArray, FloatArray]:
    """Places ``(M, 2)`` of matched features and their displacements ``(M, 2)``, px."""
    places: list[FloatArray] = []
    descriptors = []
    for grey, image in zip(eight_bit(reference, current), (reference, current), strict=True):
        kept = _known.setdefault(image, {}) if image is reference else {}
        found = kept[most] if most in kept else kept.setdefault(most, _features(grey, image, most))
        if len(found[0]) < 2:
            return np.empty((0, 2)), np.empty((0, 2))
        places.append(found[0])
        descriptors.append(found[1])
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(descriptors[0], descriptors[1], k=2)
    good = [(p[0].queryIdx, p[0].trainIdx) for p in pairs if p[0].distance < _RATIO * p[1].distance]
    matched = np.array(good, np.int64).reshape(-1, 2)
    start = places[0][matched[:, 0]]
    return start, places[1][matched[:, 1]] - start


def _features(grey: NDArray[np.uint8], image: PreparedImage, most: int) -> tuple[FloatArray, NDArray[np.float32]]:
    """Places ``(M, 2)`` of the strongest features and their descriptors ``(M, 128)``; only where the mask is."""
    x, y, width, height = (0, 0, *grey.shape[::-1]) if image.mask is None else cv2.boundingRect(image.mask)
    part = (slice(y, y + height), slice(x, x + width))
    mask = None if image.mask is None else np.ascontiguousarray(image.mask[part])
    if not (width and height):
        return np.empty((0, 2)), np.empty((0, 128), np.float32)
    found, described = cv2.SIFT.create(nfeatures=most).detectAndCompute(np.ascontiguousarray(grey[part]), mask)
    if described is None:
        return np.empty((0, 2)), np.empty((0, 128), np.float32)
    return np.array([keypoint.pt for keypoint in found]) + np.array([x, y]), np.asarray(described, np.float32)


def _consistent(places: FloatArray, moved: FloatArray) -> BoolArray:
    """Matches that agree with the median of their neighbours' displacements, allowing for their slope."""
    _, near = KDTree(places).query(places, k=_NEIGHBOURS + 1)
    around = moved[np.asarray(near)[:, 1:]]
    middle = np.median(around, axis=1)
    spread = np.median(np.abs(around - middle[:, None]), axis=1).max(axis=1)
    off = np.abs(moved - middle).max(axis=1)
    return off < np.maximum(_CONSISTENT_PX, 3.0 * np.minimum(spread, 5.0 * _CONSISTENT_PX))


def _local_affine(places: FloatArray, moved: FloatArray, points_px: FloatArray) -> FloatArray:
    """Least-squares affine maps of the nearest matches about each point, ``(N, 6)``; robust by one reweighting."""
    _, near = KDTree(places).query(points_px, k=_NEIGHBOURS)
    offset, around = places[near] - points_px[:, None], moved[near]
    design = np.concatenate([np.ones((*near.shape, 1)), offset / 50.0], axis=2)
    weight = np.ones(near.shape)
    ridge = np.diag([1e-9, 1e-3, 1e-3])
    fitted = np.zeros((len(points_px), 3, 2))
    for _ in range(3):
        weighted = np.swapaxes(design * weight[..., None], 1, 2)
        fitted = np.linalg.solve(weighted @ design + ridge, weighted @ around)
        off = np.linalg.norm(around - design @ fitted, axis=2)
        weight = 1.0 / (1.0 + (off / np.maximum(np.median(off, axis=1, keepdims=True), 0.5)) ** 2)
    slopes = fitted[:, 1:] / 50.0
    return np.stack(
        [fitted[:, 0, 0], slopes[:, 0, 0], slopes[:, 1, 0], fitted[:, 0, 1], slopes[:, 0, 1], slopes[:, 1, 1]], axis=1
    )
