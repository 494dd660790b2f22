"""The split line of biprism images: seen where it cuts the target, else placed in the gap between the two grids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration.dots.candidates import Blobs, find_blobs
from bscd.calibration.dots.findings import Image, SplitLine
from bscd.calibration.dots.links import typical_pitch
from bscd.calibration.dots.patches import find_patches
from bscd.calibration.dots.pixels import checked, noise_level
from bscd.errors import CheckFailedError, InputError

_BAND = (0.25, 0.75)  # of the width: where the line may be
_BLOCK = 8  # rows averaged
_TILTS = np.linspace(-0.04, 0.04, 41)
_COVERAGE = 0.3  # of the rows, for an edge to be looked at
_EDGES = 6
_SIDE_PX = (2, 5)  # beside the line, clear of the blur
_SAME_PLACE_PX = 1.0
_IMAGES_FOR_GAP = 5
_DOTS_IN_GRID = 20
_PIXEL_SIGMA = 0.3  # a sharp step is somewhere in its pixel


@dataclass(frozen=True)
class _Edge:
    """A straight, nearly vertical edge: its line, its uncertainty, and whether it cuts dots."""

    column_px: float
    tilt: float
    sigma_px: float
    cuts_dots: bool


def find_split(images: Sequence[Image] | Image) -> SplitLine:
    """Find the line between the halves in one or several biprism images taken with the prism at the same place.

    The discontinuity is seen where it cuts the target: an edge along a straight line with dots cut off at it, or,
    in a scan, an edge that stays where it is while the target's own edges move. Where it cuts nothing it can not
    be seen, and the middle of the gap between the two dot grids serves (``found`` False).

    Raises
    ------
    InputError
        No image, or images of different sizes.
    CheckFailedError
        Neither the line nor two grids with a gap between them near the middle.
    """
    several = [images] if isinstance(images, np.ndarray) and images.ndim == 2 else list(images)
    if not several:
        raise InputError("split line: no image given")
    several = [checked(image) for image in several]
    if len({image.shape for image in several}) > 1:
        raise InputError("split line: the images differ in size; take them with one camera setting")
    middle = (several[0].shape[0] - 1) / 2.0
    edges = [_edges(image) for image in several]
    seen = _cutting(edges) or _staying(edges)
    if seen is not None:
        return SplitLine(seen.column_px, seen.tilt, True, seen.sigma_px, middle)
    return _gap(several, middle)


def _cutting(edges: list[list[_Edge]]) -> _Edge | None:
    """The mean of the edges that cut dots, if all images that have one agree."""
    cutting = [e for per_image in edges for e in per_image if e.cuts_dots]
    if not cutting:
        return None
    column = float(np.median([e.column_px for e in cutting]))
    agreeing = [e for e in cutting if abs(e.column_px - column) < _SAME_PLACE_PX]
    return _mean(agreeing) if 2 * len(agreeing) > len(cutting) else None


def _staying(edges: list[list[_Edge]]) -> _Edge | None:
    """The only edge that is at one place in most images, while others move."""
    if len(edges) < 3:
        return None
    every = [e for per_image in edges for e in per_image]
    groups: list[list[_Edge]] = []
    for edge in sorted(every, key=lambda e: e.column_px):
        if groups and abs(edge.column_px - np.mean([e.column_px for e in groups[-1]])) < _SAME_PLACE_PX:
            groups[-1].append(edge)
        else:
            groups.append([edge])
    lasting = [g for g in groups if len(g) > len(edges) / 2]
    return _mean(lasting[0]) if len(lasting) == 1 and len(groups) > 2 else None


def _mean(edges: list[_Edge]) -> _Edge:
    columns = np.array([e.column_px for e in edges])
    sigma = float(np.hypot(np.median([e.sigma_px for e in edges]), columns.std() / np.sqrt(len(edges))))
    return _Edge(float(columns.mean()), float(np.mean([e.tilt for e in edges])), sigma, True)


def _edges(image: Image) -> list[_Edge]:
    """The strongest straight edges near the middle of an image."""
    height, width = image.shape
    first, last = (int(share * width) for share in _BAND)
    grey = np.asarray(image[: height // _BLOCK * _BLOCK], np.float32)
    blocks = grey.reshape(-1, _BLOCK, width).mean(axis=1)
    low, high = (float(v) for v in np.percentile(blocks, (5, 95)))
    step = np.zeros_like(blocks)
    step[:, 1:-1] = np.abs(blocks[:, 2:] - blocks[:, :-2])
    sharp = step > max(0.2 * (high - low), 4.0 * noise_level(image))
    wide = sharp.copy()
    wide[:, 1:-1] |= sharp[:, 2:] | sharp[:, :-2]
    about = (np.arange(len(blocks)) + 0.5) * _BLOCK - 0.5 - (height - 1) / 2.0
    columns = np.arange(first, last)
    rows = np.arange(len(blocks))[:, None]
    cover = np.stack(
        [wide[rows, np.clip(np.rint(columns + t * about[:, None]), 0, width - 1).astype(int)].mean(0) for t in _TILTS]
    )
    found = []
    for _ in range(_EDGES):
        t, c = np.unravel_index(int(cover.argmax()), cover.shape)
        if cover[t, c] < _COVERAGE:
            break
        edge = _refined(grey, step, sharp, about, float(columns[c]), float(_TILTS[t]), (low, high))
        if edge is not None:
            found.append(edge)
        cover[:, max(c - 8, 0) : c + 9] = 0.0
    return found


def _refined(
    grey: FloatArray,
    step: FloatArray,
    sharp: np.ndarray,
    about: FloatArray,
    column: float,
    tilt: float,
    levels: tuple[float, float],
) -> _Edge | None:
    """Fit the line to the steps' centroids, then look along both of its sides."""
    reach = np.arange(-3, 4)
    kept, spread = np.arange(len(step)), np.inf
    for _ in range(3):
        centre = np.clip(np.rint(column + tilt * about[kept]), 4, step.shape[1] - 5).astype(int)
        window = centre[:, None] + reach
        weight = step[kept[:, None], window] * (np.any(sharp[kept[:, None], window], axis=1, keepdims=True))
        has = weight.sum(axis=1) > 0
        if has.sum() < 8:
            return None
        kept, weight, window = kept[has], weight[has], window[has]
        place = (weight * window).sum(axis=1) / weight.sum(axis=1)
        design = np.stack([np.ones(len(kept)), about[kept]], axis=1)
        (column, tilt), *_ = np.linalg.lstsq(design, place, rcond=None)
        miss = place - design @ (column, tilt)
        spread = float(np.median(np.abs(miss)) * 1.4826) + 1e-3
        kept = kept[np.abs(miss) < 3.0 * spread]
    if spread > 1.0:
        return None
    return _Edge(
        float(column),
        float(tilt),
        spread / np.sqrt(max(len(kept), 1)) + _PIXEL_SIGMA,
        _cuts(grey, column, tilt, levels),
    )


def _cuts(grey: FloatArray, column: float, tilt: float, levels: tuple[float, float]) -> bool:
    """Whether dots end at the line: one side has a row of dark gaps, and its bright rows end at the line."""
    rows = np.arange(len(grey))
    line = column + tilt * (rows - (len(grey) - 1) / 2.0)
    sides = []
    for sign in (-1, 1):
        near = np.rint(line[:, None] + sign * np.arange(*_SIDE_PX)).astype(int)
        sides.append(grey[rows[:, None], np.clip(near, 0, grey.shape[1] - 1)].mean(axis=1))
    for own, other in (sides, sides[::-1]):
        bright_level = float(np.percentile(own, 80))
        middle = (bright_level + levels[0]) / 2.0
        if bright_level - levels[0] < 0.3 * (levels[1] - levels[0]):
            continue
        bright = own > middle
        first, last = int(bright.argmax()), len(bright) - int(bright[::-1].argmax())
        gaps = ~bright[first:last]
        starts = int((np.diff(gaps.astype(np.int8)) == 1).sum())
        ends_there = float((other[bright] < middle).mean())
        if starts >= 4 and 0.04 < gaps.mean() < 0.75 and ends_there > 0.85:
            return True
    return False


def _gap(images: list[Image], middle_row: float) -> SplitLine:
    """The middle of the gap between the grids of all images, as a line through the midpoints row by row."""
    chosen = np.unique(np.linspace(0, len(images) - 1, _IMAGES_FOR_GAP).astype(int))
    grids = [grid for k in chosen for grid in _grids(images[k])]
    width = images[0].shape[1]
    low = np.array([g[:, 0].min() for g in grids])
    high = np.array([g[:, 0].max() for g in grids])
    best: tuple[float, float] | None = None
    for end in high:
        start = low[low > end].min(initial=np.inf)
        clear = np.isfinite(start) and not ((low < start) & (high > end)).any()
        centred = _BAND[0] * width < (start + end) / 2.0 < _BAND[1] * width
        if clear and centred and (best is None or start - end > best[1] - best[0]):
            best = (float(end), float(start))
    if best is None:
        raise CheckFailedError(
            "split line: neither the line nor a gap between two dot grids is seen near the image's middle; check that "
            "the biprism is raised and that both halves show the target"
        )
    left = _border(np.concatenate([g for g, h in zip(grids, high, strict=True) if h <= best[0]]), 1, middle_row)
    right = _border(np.concatenate([g for g, b in zip(grids, low, strict=True) if b >= best[1]]), -1, middle_row)
    column, tilt = (left + right) / 2.0
    return SplitLine(float(column), float(tilt), False, float((right[0] - left[0]) / np.sqrt(12.0)), middle_row)


def _grids(image: Image) -> list[FloatArray]:
    """Positions ``(N, 2)`` of the dots of each grid in an image."""
    blobs: Blobs = find_blobs(image)
    blobs = blobs.keep(blobs.roundness > 0.85)
    patches = find_patches(blobs, typical_pitch(blobs))
    return [blobs.xy_px[p.member] for p in patches if len(p.member) >= _DOTS_IN_GRID]


def _border(dots: FloatArray, sign: int, middle_row: float) -> FloatArray:
    """(column at the middle row, tilt) of a line along the outermost dots on one side."""
    bands = np.array_split(np.argsort(dots[:, 1]), 12)
    outer = np.array([dots[b][np.argmax(sign * dots[b, 0])] for b in bands if len(b)])
    tilt = np.polyfit(outer[:, 1] - middle_row, outer[:, 0], 1)[0] if len(outer) > 3 else 0.0
    tilt = float(np.clip(tilt, _TILTS[0], _TILTS[-1]))
    return np.array([np.median(outer[:, 0] - tilt * (outer[:, 1] - middle_row)), tilt])
