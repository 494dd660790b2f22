"""Links between blobs that are neighbours in a square lattice, and the patches that hang together by them.

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

_NEIGHBOURS = 16
_TOLERANCE = 0.25  # of the expected distance
_AREA_RATIO = 1.8
_STEP_CHANGE = 0.1  # of the pitch: a link this unlike both that it continues crosses the cube's edge
_RIGHT, _DOWN, _LEFT, _UP = range(4)
_STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))  # (row, column)
#: Blobs in the smallest patch: one cell.
SMALLEST = 4


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


def linked_patches(blobs: Blobs, pitch_per_radius: float) -> list[Patch]:
    """The patches among the blobs, largest first."""
    if len(blobs) < SMALLEST:
        return []
    links = _in_cells(_without_jumps(_links(blobs, pitch_per_radius), blobs))
    return sorted(_connected(links), key=lambda p: -len(p.member))


def typical_pitch(blobs: Blobs) -> float:
    """The distance to the nearest neighbour in the dots' own radii: the median; what the lattice's pitch is.

    For images whose target is not known here; with it, the ratio is known exactly.
    """
    if len(blobs) < SMALLEST:
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


def _without_jumps(links: IntArray, blobs: Blobs) -> IntArray:
    """Without the links along rows that are unlike the links before and after them: they lead to the other face."""
    kept = links.copy()
    steps = np.where(links[..., None] >= 0, blobs.xy_px[links] - blobs.xy_px[:, None], np.nan)
    start = np.flatnonzero(links[:, _RIGHT] >= 0)
    end = links[start, _RIGHT]
    own, before, after = steps[start, _RIGHT], -steps[start, _LEFT], steps[end, _RIGHT]
    limit = _STEP_CHANGE * np.linalg.norm(own, axis=1)
    jump = (np.linalg.norm(own - before, axis=1) > limit) & (np.linalg.norm(own - after, axis=1) > limit)
    kept[start[jump], _RIGHT] = -1
    kept[end[jump], _LEFT] = -1
    return kept


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
        if len(good) >= SMALLEST:
            row, column = np.array([place[int(m)] for m in good]).T
            patches.append(Patch(good, row - row.min(), column - column.min()))
    return patches
