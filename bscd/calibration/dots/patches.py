"""Patches: blobs that hang together as a square lattice, with their row and column in it.

A dot's own ellipse tells how its surroundings are foreshortened: measured in it, the four neighbours lie at
pitch / radius in every view. A link counts only if both ends agree and it is a side of a closed cell, so
background clutter, the other face and diagonal neighbours do not link.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from bscd.arrays import FloatArray, IntArray
from bscd.calibration.dots.candidates import Blobs
from bscd.calibration.dots.face_map import FaceMap, fit_face_map

_NEIGHBOURS = 16
_TOLERANCE = 0.25  # of the expected distance
_AREA_RATIO = 1.8
_RIGHT, _DOWN, _LEFT, _UP = range(4)
_STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))  # (row, column)
_SMALLEST = 4
_MATCH = 0.15  # of the pitch, about a predicted place
_SPARSE = 0.5  # of the usual number of dots in a line: less does not count as one
_CONTINUES = 0.06  # of the pitch: how well a border line goes on from the others


@dataclass(frozen=True)
class Patch:
    """Blobs ``member`` ``(N,)`` of one lattice with their ``row`` and ``column`` ``(N,)``, both counted from 0."""

    member: IntArray
    row: IntArray
    column: IntArray

    @property
    def rows(self) -> int:
        """Rows spanned."""
        return int(self.row.max()) + 1

    @property
    def columns(self) -> int:
        """Columns spanned."""
        return int(self.column.max()) + 1

    @property
    def lattice(self) -> FloatArray:
        """Positions ``(N, 2)`` (column, row)."""
        return np.stack([self.column, self.row], axis=-1).astype(np.float64)

    def keep(self, selection: np.ndarray, recount: bool = True) -> Patch:
        """The part at a selection, counted from 0 again unless told not to."""
        row, column = self.row[selection], self.column[selection]
        first_row, first_column = (row.min(), column.min()) if recount else (0, 0)
        return Patch(self.member[selection], row - first_row, column - first_column)


def find_patches(blobs: Blobs, pitch_per_radius: float) -> list[Patch]:
    """All lattices among the blobs, largest first.

    Filled up with blobs that sit where their maps expect them, without border lines that do not belong.
    """
    if len(blobs) < _SMALLEST:
        return []
    links = _in_cells(_links(blobs, pitch_per_radius))
    patches = sorted(_connected(links), key=lambda p: -len(p.member))
    taken = np.zeros(len(blobs), bool)
    for patch in patches:
        taken[patch.member] = True
    done = []
    for patch in patches:
        filled = _filled(patch, blobs, taken)
        taken[filled.member] = True
        done.append(_trimmed(filled, blobs))
    return sorted(done, key=lambda p: -len(p.member))


def typical_pitch(blobs: Blobs) -> float:
    """The distance to the nearest neighbour in the dots' own radii: the median; what the lattice's pitch is.

    For images whose target is not known here; with it, the ratio is known exactly.
    """
    if len(blobs) < _SMALLEST:
        return 4.0
    other = _nearest(blobs, 1)[:, 0]
    offset = blobs.xy_px[other] - blobs.xy_px
    return float(np.median(np.sqrt(np.einsum("ni,nij,nj->n", offset, np.linalg.inv(blobs.shape), offset))))


def _nearest(blobs: Blobs, count: int) -> IntArray:
    """``(N, count)`` the nearest other blobs."""
    return np.asarray(KDTree(blobs.xy_px).query(blobs.xy_px, k=count + 1)[1], np.int64)[:, 1:]


def _links(blobs: Blobs, pitch_per_radius: float) -> IntArray:
    """``(N, 4)`` the neighbour to the right, below, left, above; -1 for none. Mutual by construction."""
    count = min(_NEIGHBOURS, len(blobs) - 1)
    other = _nearest(blobs, count)
    offset = blobs.xy_px[other] - blobs.xy_px[:, None]
    inverse = np.linalg.inv(blobs.shape)
    own = np.sqrt(np.einsum("nki,nij,nkj->nk", offset, inverse, offset)) / pitch_per_radius
    theirs = np.sqrt(np.einsum("nki,nkij,nkj->nk", offset, inverse[other], offset)) / pitch_per_radius
    ratio = blobs.area_px[other] / blobs.area_px[:, None]
    off = np.maximum(np.abs(own - 1.0), np.abs(theirs - 1.0))
    off[(ratio > _AREA_RATIO) | (ratio < 1.0 / _AREA_RATIO)] = np.inf
    x, y = offset[..., 0], offset[..., 1]
    across = np.abs(x) >= np.abs(y)
    direction = np.where(across, np.where(x > 0, _RIGHT, _LEFT), np.where(y > 0, _DOWN, _UP))
    best = np.full((len(blobs), 4), -1, np.int64)
    for d in range(4):
        cost = np.where(direction == d, off, np.inf)
        k = cost.argmin(axis=1)
        best[:, d] = np.where(cost[np.arange(len(k)), k] < _TOLERANCE, other[np.arange(len(k)), k], -1)
    for d in range(4):
        back = np.where(best[:, d] >= 0, best[best[:, d], (d + 2) % 4], -1)
        best[:, d] = np.where(back == np.arange(len(best)), best[:, d], -1)
    return best


def _in_cells(links: IntArray) -> IntArray:
    """Only the links that are a side of a closed cell."""

    def follow(start: IntArray, d: int) -> IntArray:
        return np.where(start >= 0, links[start, d], -1)

    every = np.arange(len(links))
    kept = np.full_like(links, -1)
    for d in range(4):
        end = follow(every, d)
        for turn in (1, 3):
            side = (d + turn) % 4
            far, near = follow(end, side), follow(follow(every, side), d)
            closed = (end >= 0) & (far >= 0) & (far == near)
            kept[closed, d] = end[closed]
    return kept


def _connected(links: IntArray) -> list[Patch]:
    """Connected components with consistent coordinates; blobs whose links contradict are left out."""
    place: dict[int, tuple[int, int]] = {}
    patches = []
    for start in np.flatnonzero((links >= 0).any(axis=1)):
        if int(start) in place:
            continue
        place[int(start)] = (0, 0)
        members, queue, used, wrong = [int(start)], deque([int(start)]), {(0, 0): int(start)}, set()
        while queue:
            i = queue.popleft()
            for d, (down, right) in enumerate(_STEPS):
                j = int(links[i, d])
                if j < 0:
                    continue
                here = (place[i][0] + down, place[i][1] + right)
                if j not in place:
                    place[j] = here
                    members.append(j)
                    queue.append(j)
                    if used.setdefault(here, j) != j:
                        wrong |= {j, used[here]}
                elif place[j] != here:
                    wrong |= {i, j}
        good = np.array([m for m in members if m not in wrong], np.int64)
        if len(good) >= _SMALLEST:
            row, column = np.array([place[int(m)] for m in good]).T
            patches.append(Patch(good, row - row.min(), column - column.min()))
    return patches


def _filled(patch: Patch, blobs: Blobs, taken: np.ndarray) -> Patch:
    """The patch with free blobs added where its map expects dots, in holes and one step around it."""
    tree = KDTree(blobs.xy_px)
    member, row, column = patch.member, patch.row, patch.column
    for _ in range(4):
        lattice = np.stack([column, row], axis=-1)
        face_map = fit_face_map(lattice, blobs.xy_px[member], highest=3)
        free = _places_around(lattice)
        pixels, jacobian = face_map.pixels(free), face_map.jacobian(free)
        near = np.asarray(tree.query(pixels)[1], np.int64)
        inverse = np.linalg.inv(jacobian)
        off = np.linalg.norm(np.einsum("nij,nj->ni", inverse, blobs.xy_px[near] - pixels), axis=1)
        fits = (off < _MATCH) & ~taken[near] & ~np.isin(near, member)
        fits &= _same_shape(face_map, free, blobs.shape[near], patch, blobs)
        fits &= np.bincount(near[fits], minlength=len(blobs))[near] <= 1
        if not fits.any():
            break
        member = np.concatenate([member, near[fits]])
        column = np.concatenate([column, free[fits, 0]])
        row = np.concatenate([row, free[fits, 1]])
        column, row = column - column.min(), row - row.min()
    return Patch(member, row, column)


def _trimmed(patch: Patch, blobs: Blobs) -> Patch:
    """The patch without outermost rows or columns that are sparse or not where the rest of its map puts them.

    A line too many would shift all labels; a true line lost here is found again from the map.
    """
    checking = True
    while checking and min(patch.rows, patch.columns) > 2:
        checking = False
        for axis, values in ((0, patch.column), (1, patch.row)):
            usual = np.median(np.bincount(values)[np.bincount(values) > 0])
            for extreme in (0, int(values.max())):
                line = values == extreme
                if line.sum() < _SPARSE * usual or not _continues(patch, line, axis, blobs):
                    patch, checking = patch.keep(~line), True
                    break
            if checking:
                break
    return patch


def _continues(patch: Patch, line: np.ndarray, axis: int, blobs: Blobs) -> bool:
    """Whether a border line is where, and as large as, the rest of the patch predicts."""
    rest = patch.lattice[~line]
    if len(np.unique(rest[:, axis])) < 3 or len(rest) < 2 * _SMALLEST:
        return True
    face_map = fit_face_map(rest, blobs.xy_px[patch.member[~line]], highest=3)
    places = patch.lattice[line]
    step = blobs.xy_px[patch.member[line]] - face_map.pixels(places)
    off = np.einsum("nij,nj->ni", np.linalg.inv(face_map.jacobian(places)), step)
    alike = _same_shape(face_map, places, blobs.shape[patch.member[line]], patch.keep(~line, recount=False), blobs)
    return bool(np.linalg.norm(np.median(off, axis=0)) < _CONTINUES and alike.mean() > 0.5)


def _places_around(lattice: IntArray) -> IntArray:
    """Free lattice places ``(M, 2)`` next to an occupied one, also diagonally."""
    low = lattice.min(0) - 1
    occupied = np.zeros(lattice.max(0) - low + 2, bool)
    occupied[tuple((lattice - low).T)] = True
    near = np.zeros_like(occupied)
    for a, b in np.ndindex(3, 3):
        near |= np.roll(occupied, (a - 1, b - 1), axis=(0, 1))
    return np.argwhere(near & ~occupied) + low


def _same_shape(
    face_map: FaceMap, places: IntArray | FloatArray, shape: FloatArray, patch: Patch, blobs: Blobs
) -> np.ndarray:
    """Whether ellipses agree with those of the patch carried there by its map."""
    unit = np.linalg.inv(face_map.jacobian(patch.lattice))
    seen = unit @ blobs.shape[patch.member] @ np.swapaxes(unit, -1, -2)
    usual = np.median(seen, axis=0)
    here = np.linalg.inv(face_map.jacobian(places))
    ratio = np.linalg.inv(usual) @ here @ shape @ np.swapaxes(here, -1, -2)
    trace, det = np.trace(ratio, axis1=-2, axis2=-1), np.linalg.det(ratio)
    return (det > 0.55) & (det < 1.8) & (trace > 1.5) & (trace < 2.8)
