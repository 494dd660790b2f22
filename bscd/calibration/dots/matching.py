"""Which mark is which on a surveyed body: from a few seeds or an approximate camera, refined on all marks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from bscd.arrays import FloatArray, IntArray
from bscd.calibration.dlt import DltCamera, fit_dlt
from bscd.calibration.dots.findings import MarkFinding, Marks, MarkSeed, MissingDot
from bscd.calibration.target import PointsTarget
from bscd.errors import CheckFailedError, InputError

_FEWEST_SEEDS = 6
_PASSES = 12
_NEAR = 0.35  # of the distance to the next mark, about where a mark is expected
_OUTLIER = 6.0  # robust spreads
_GRAZING = 0.25  # cosine of the steepest view at which a mark is looked for
_NEIGHBOURS = 8
_SIZE_RATIO = 2.5
_DISTORTION_DEGREE, _MARKS_FOR_DISTORTION = 3, 30


def match_marks(
    marks: Marks,
    target: PointsTarget,
    *,
    seeds: Sequence[MarkSeed] | None = None,
    camera: DltCamera | None = None,
    grazing_cosine: float = _GRAZING,
) -> MarkFinding:
    """Label marks of a body whose marks are surveyed.

    The camera (11-parameter DLT) from the seeds tells where every mark should be; the marks found there refine it,
    and what lens distortion the camera leaves is fitted by a polynomial over the image, until nothing changes.
    Marks on the body's far side are not looked for: the body is taken as convex, a mark's normal from its
    neighbours.

    Parameters
    ----------
    marks
        From `find_marks`.
    target
        The surveyed marks.
    seeds
        At least 6 marks whose labels are known, not all in one plane; or
    camera
        a camera that projects the marks to within a third of their spacing.
    grazing_cosine
        Marks seen more from the side than this (cosine of the angle to their normal) are left out.

    Raises
    ------
    InputError
        Too few seeds, unknown labels, no mark where a seed says.
    CheckFailedError
        The marks do not fit the target.
    """
    points = np.asarray(target.xyz_mm, np.float64)
    fixed = np.empty((0, 2), np.int64)
    if camera is None:
        fixed = _seeded(marks, target, list(seeds or ()))
        camera = fit_dlt(points[fixed[:, 0]], marks.xy_px[fixed[:, 1]], "refined")
    normals = _normals(points)
    pairs = fixed
    for _ in range(_PASSES):
        seen = np.flatnonzero(_facing(points, normals, camera, pairs[:, 0]) > grazing_cosine)
        expected = camera.project(points[seen])
        expected += _distortion(expected, camera.project(points[pairs[:, 0]]), marks.xy_px[pairs[:, 1]])
        found = _pairs(marks, seen, expected)
        if len(found) < _FEWEST_SEEDS:
            raise CheckFailedError(
                f"marks: only {len(found)} of {len(points)} are where the seeds say; check the seeds' labels and that "
                "the table of positions belongs to this body"
            )
        if len(found) == len(pairs) and (found == pairs).all():
            break
        pairs = found
        camera = fit_dlt(points[pairs[:, 0]], marks.xy_px[pairs[:, 1]], "refined")
    return _finding(marks, target, camera, pairs, _facing(points, normals, camera, pairs[:, 0]) > grazing_cosine)


def _seeded(marks: Marks, target: PointsTarget, seeds: list[MarkSeed]) -> IntArray:
    """``(N, 2)`` (place in the target, mark) of the seeds."""
    if len(seeds) < _FEWEST_SEEDS:
        raise InputError(f"marks: {len(seeds)} seeds given, at least {_FEWEST_SEEDS} are needed, not all in one plane")
    pairs = []
    for seed in seeds:
        if seed.label not in target.labels:
            raise InputError(f"marks: seed label {seed.label!r} is not in the target's table")
        off = np.linalg.norm(marks.xy_px - np.asarray(seed.xy_px), axis=1)
        if len(off) == 0 or off.min() > np.sqrt(marks.area_px[off.argmin()]):
            raise InputError(f"marks: seed {seed.label!r}: no mark at ({seed.xy_px[0]:.0f}, {seed.xy_px[1]:.0f}) px")
        pairs.append((target.labels.index(seed.label), int(off.argmin())))
    return np.array(pairs, np.int64)


def _normals(points: FloatArray) -> FloatArray:
    """Outward unit normals ``(N, 3)``: across the nearest neighbours, away from the body's middle."""
    count = min(_NEIGHBOURS, len(points) - 1)
    near = points[np.asarray(KDTree(points).query(points, k=count + 1)[1])]
    centred = near - near.mean(axis=1, keepdims=True)
    normals = np.linalg.svd(centred)[2][:, 2]
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    return normals * np.where(np.einsum("ni,ni->n", normals, points - middle) < 0, -1.0, 1.0)[:, None]


def _facing(points: FloatArray, normals: FloatArray, camera: DltCamera, labelled: IntArray) -> FloatArray:
    """Cosine ``(N,)`` of the angle between each normal and the direction to the camera.

    A few labelled marks do not tell where the camera is; that it sees them tells the direction well enough.
    """
    if 0 < len(labelled) < _MARKS_FOR_DISTORTION:
        towards = normals[labelled].mean(axis=0)
        return normals @ towards / max(float(np.linalg.norm(towards)), 1e-9)
    matrix = camera.matrix
    to_camera = -np.linalg.solve(matrix[:, :3], matrix[:, 3]) - points
    return np.einsum("ni,ni->n", normals, to_camera) / np.linalg.norm(to_camera, axis=1)


def _distortion(at_px: FloatArray, expected_px: FloatArray, seen_px: FloatArray) -> FloatArray:
    """What the camera misses by, ``(N, 2)`` px at positions ``(N, 2)``: a polynomial through the labelled marks."""
    if len(seen_px) < _MARKS_FOR_DISTORTION:
        return np.zeros_like(at_px)
    middle, scale = expected_px.mean(axis=0), np.ptp(expected_px, axis=0).max() / 2.0
    orders = range(_DISTORTION_DEGREE + 1)
    powers = [(i, j) for i in orders for j in orders if i + j <= _DISTORTION_DEGREE]

    def design(xy_px: FloatArray) -> FloatArray:
        x, y = ((xy_px - middle) / scale).T
        return np.stack([x**i * y**j for i, j in powers], axis=1)

    return design(at_px) @ np.linalg.lstsq(design(expected_px), seen_px - expected_px, rcond=None)[0]


def _pairs(marks: Marks, seen: IntArray, expected: FloatArray) -> IntArray:
    """``(M, 2)`` (place in the target, mark): nearest to each other, near enough, of like size, no outliers.

    ``seen`` ``(N,)`` are the places in the target that are looked for, ``expected`` ``(N, 2)`` px where.
    """
    if len(seen) < _FEWEST_SEEDS or len(marks) == 0:
        return np.empty((0, 2), np.int64)
    spacing = np.asarray(KDTree(expected).query(expected, k=2)[0])[:, 1]
    off, mark = (np.asarray(v) for v in KDTree(marks.xy_px).query(expected))
    back = np.asarray(KDTree(expected).query(marks.xy_px)[1])[mark]
    good = (off < _NEAR * spacing) & (back == np.arange(len(seen)))
    if not good.any():
        return np.empty((0, 2), np.int64)
    spread = 1.4826 * float(np.median(off[good]))
    size = marks.area_px[mark] / spacing**2
    ratio = size / np.median(size[good])
    good &= (off < max(_OUTLIER * spread, 1.0)) & (ratio < _SIZE_RATIO) & (ratio > 1.0 / _SIZE_RATIO)
    return np.stack([seen[good], mark[good]], axis=1).astype(np.int64)


def _finding(marks: Marks, target: PointsTarget, camera: DltCamera, pairs: IntArray, facing: np.ndarray) -> MarkFinding:
    expected = camera.project(np.asarray(target.xyz_mm, np.float64))
    missing = tuple(
        MissingDot(
            int(k),
            "no mark of its size is where it should be" if facing[k] else "turned away from the camera",
            (float(expected[k, 0]), float(expected[k, 1])),
        )
        for k in np.setdiff1d(np.arange(len(target.labels)), pairs[:, 0])
    )
    mark = pairs[:, 1]
    return MarkFinding(pairs[:, 0], marks.xy_px[mark], marks.sigma_px[mark], missing, camera.rms_px)
