"""Which dot is which: faces, rows and columns of a plain grid, from its full counts and the cube's edge.

Nothing is guessed: what the counts, the ends of the grid in view, the geometry of both faces or a seed do not
determine is an error that asks for a seed dot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from bscd.arrays import FloatArray, IntArray
from bscd.calibration.dlt import fit_dlt
from bscd.calibration.dots.candidates import Blobs
from bscd.calibration.dots.ends import Ends
from bscd.calibration.dots.findings import Seed
from bscd.calibration.dots.links import Patch
from bscd.calibration.observations import PoseName
from bscd.calibration.target import GridTarget
from bscd.errors import CheckFailedError, InputError

_RIVAL_SHARE = 0.5  # of the dots: a further grid this large is a second view of the cube
_SQUEEZED = 0.62  # a face this much narrower than the widest is not the one that faces the camera
_MISFIT = 0.06  # of the pitch: rms of the view of both faces
_CLEARLY = 2.0  # times the best misfit, for any other labelling
_DOTS_FOR_GEOMETRY = 60
_SEED_HINT = "give a seed dot (its face, row, column and position)"


@dataclass(frozen=True)
class LabelledPatch:
    """A patch with its face and the target's ``row`` and ``column`` ``(N,)`` for each ``member`` ``(N,)``."""

    face: int
    member: IntArray
    row: IntArray
    column: IntArray


@dataclass(frozen=True)
class _Placement:
    """Labels a patch may have: its face, and the row and column of its topmost row and its column at the edge."""

    patch: Patch
    face: int
    rows: Sequence[int]
    columns: Sequence[int]

    def labelled(self, row: int, column: int) -> LabelledPatch:
        own = self.patch.column if self.face == 0 else self.patch.columns - 1 - self.patch.column
        return LabelledPatch(self.face, self.patch.member, self.patch.row + row, own + column)


def label(
    patches: list[Patch], ends: list[Ends], blobs: Blobs, target: GridTarget, pose: PoseName, seed: Seed | None
) -> list[LabelledPatch]:
    """Labels for the patches that can have them (``CheckFailedError`` where they can not be determined)."""
    if not patches:
        raise CheckFailedError(
            f"dots: no dot grid in this image (pitch to diameter as {target.pitch_mm:g} to "
            f"{target.dot_diameter_mm:g} mm); check light, focus and [target]"
        )
    chosen = _label_corner if pose == "corner" else _label_face
    return chosen(patches, ends, blobs, target, seed)


def _label_face(
    patches: list[Patch], ends: list[Ends], blobs: Blobs, target: GridTarget, seed: Seed | None
) -> list[LabelledPatch]:
    if seed is not None:
        placement = _seeded(seed, patches, blobs, target)
        return [placement.labelled(placement.rows[0], placement.columns[0])]
    widths = np.array([_width_share(p, blobs) for p in patches])
    sizes = np.array([len(p.member) for p in patches])
    large = sizes > _RIVAL_SHARE * sizes[0]
    frontal = np.flatnonzero(large & (widths > _SQUEEZED * widths[large].max()))
    if len(frontal) > 1:
        raise CheckFailedError(
            f"dots: {len(frontal)} faces are seen about equally well where the face pose shows one; check the "
            "rotation stage, and give the half if this is an image through the biprism"
        )
    best = int(np.argmax(widths * sizes))
    patch, end = patches[best], ends[best]
    rows, columns = _allowed(patch, end, 0, target)
    if len(rows) > 1 or len(columns) > 1:
        _refuse_partial(patch, target)
    return [_Placement(patch, 0, rows, columns).labelled(rows[0], columns[0])]


def _label_corner(
    patches: list[Patch], ends: list[Ends], blobs: Blobs, target: GridTarget, seed: Seed | None
) -> list[LabelledPatch]:
    if len(patches) > 2 and len(patches[2].member) > _RIVAL_SHARE * len(patches[1].member):
        raise CheckFailedError(
            f"dots: {len(patches)} separate dot grids are seen where the corner pose shows two faces; give the half "
            "if this is an image through the biprism, and clear away what covers the dots otherwise"
        )
    if len(patches) == 1 or len(patches[1].member) < 2 * target.rows // 3:
        if patches[0].columns > target.columns and target.margin_mm * 2 < 1.5 * target.pitch_mm:
            return _cut_at_edge(patches[0], ends[0], blobs, target)
        return _label_only_face(patches[0], blobs, target, seed)
    pair = sorted((0, 1), key=lambda k: float(np.median(blobs.xy_px[patches[k].member, 0])))
    trusted = [_trusted(ends[k], patches[k], patches[other]) for k, other in (pair, pair[::-1])]
    placements = [
        _Placement(patches[k], face, *_allowed(patches[k], end, face, target))
        for face, k, end in zip((1, 0), pair, trusted, strict=True)
    ]
    if seed is not None:
        fixed = _seeded(seed, [patches[k] for k in pair], blobs, target)
        placements = [fixed if p.patch is fixed.patch else p for p in placements]
        if placements[0].face == placements[1].face:
            raise InputError(f"seed: its dot is on the other face than {seed.face} (0 is the right one)")
    return _best_view([placements], blobs, target)


def _trusted(ends: Ends, patch: Patch, other: Patch) -> Ends:
    """What is left of the ends where the other face shows more: this one is cut off, whatever lies beyond."""
    rows, columns = patch.rows >= other.rows, patch.columns >= other.columns
    return Ends(ends.top and rows, ends.bottom and rows, ends.left and columns, ends.right and columns)


def _label_only_face(patch: Patch, blobs: Blobs, target: GridTarget, seed: Seed | None) -> list[LabelledPatch]:
    if seed is None:
        _refuse_count(patch, target)
        raise CheckFailedError(
            f"dots: only one face ({patch.columns} columns x {patch.rows} rows) is seen where the corner pose shows "
            f"two; turn the edge towards the camera, or {_SEED_HINT}"
        )
    placement = _seeded(seed, [patch], blobs, target)
    return [placement.labelled(placement.rows[0], placement.columns[0])]


def _cut_at_edge(patch: Patch, ends: Ends, blobs: Blobs, target: GridTarget) -> list[LabelledPatch]:
    """Two faces whose columns follow each other at about the pitch: find the column after which the edge is."""
    options = []
    for first in range(1, patch.columns):
        left, right = patch.keep(patch.column < first), patch.keep(patch.column >= first)
        if max(left.columns, right.columns) > target.columns or min(left.columns, right.columns) < 2:
            continue
        rows = [_choices(p.rows, target.rows, ends.top, ends.bottom, patch, target) for p in (left, right)]
        options.append([_Placement(left, 1, rows[0], (0,)), _Placement(right, 0, rows[1], (0,))])
    if not options:
        _refuse_count(patch, target)
    return _best_view(options, blobs, target)


def _allowed(patch: Patch, ends: Ends, face: int, target: GridTarget) -> tuple[Sequence[int], Sequence[int]]:
    edge_side, far_side = (ends.left, ends.right) if face == 0 else (ends.right, ends.left)
    return (
        _choices(patch.rows, target.rows, ends.top, ends.bottom, patch, target),
        _choices(patch.columns, target.columns, edge_side, far_side, patch, target),
    )


def _choices(
    count: int, full: int, first_ends: bool, last_ends: bool, patch: Patch, target: GridTarget
) -> Sequence[int]:
    """What the first of ``count`` rows or columns may be, of ``full``, given at which side the grid ends."""
    if count > full or (count < full and first_ends and last_ends):
        _refuse_count(patch, target, force=True)
    if first_ends:
        return (0,)
    if last_ends:
        return (full - count,)
    return range(full - count + 1)


def _refuse_count(patch: Patch, target: GridTarget, force: bool = False) -> None:
    if force or patch.columns > target.columns or patch.rows > target.rows:
        raise CheckFailedError(
            f"dots: the image shows a face of {patch.columns} columns x {patch.rows} rows, the target says "
            f"{target.columns} x {target.rows}; correct columns and rows in [target], or use the right target"
        )


def _refuse_partial(patch: Patch, target: GridTarget) -> None:
    raise CheckFailedError(
        f"dots: {patch.columns} columns x {patch.rows} rows of {target.columns} x {target.rows} are in view and the "
        f"grid's end is not, so which ones can not be told; move the target into view or {_SEED_HINT}"
    )


def _width_share(patch: Patch, blobs: Blobs) -> float:
    """How wide the dots are for their height: the cosine of the face's turn away from the camera."""
    shape = np.median(blobs.shape[patch.member], axis=0)
    return float(np.sqrt(np.linalg.det(shape)) / shape[1, 1])


def _seeded(seed: Seed, patches: list[Patch], blobs: Blobs, target: GridTarget) -> _Placement:
    """The one placement that a seed leaves to its patch."""
    if seed.face not in (0, 1) or not (0 <= seed.row < target.rows and 0 <= seed.column < target.columns):
        raise InputError(
            f"seed: face {seed.face}, row {seed.row}, column {seed.column} is not on the target (faces 0 and 1, "
            f"{target.rows} rows, {target.columns} columns, all counted from 0)"
        )
    members = np.concatenate([p.member for p in patches])
    distance = np.linalg.norm(blobs.xy_px[members] - np.asarray(seed.xy_px), axis=1)
    nearest = members[int(distance.argmin())]
    if distance.min() > np.sqrt(blobs.shape[nearest, 1, 1]):
        raise InputError(f"seed: there is no dot at ({seed.xy_px[0]:.1f}, {seed.xy_px[1]:.1f}) px")
    patch = next(p for p in patches if nearest in p.member)
    here = _Placement(patch, seed.face, (), ()).labelled(0, 0)
    k = int(np.flatnonzero(here.member == nearest)[0])
    row, column = seed.row - int(here.row[k]), seed.column - int(here.column[k])
    if row < 0 or column < 0 or row + patch.rows > target.rows or column + patch.columns > target.columns:
        raise InputError(
            f"seed: with row {seed.row}, column {seed.column} there, the {patch.columns} columns x {patch.rows} rows "
            f"in view would reach beyond the target's {target.columns} x {target.rows}"
        )
    return _Placement(patch, seed.face, (row,), (column,))


def _best_view(options: list[list[_Placement]], blobs: Blobs, target: GridTarget) -> list[LabelledPatch]:
    """The labelling of both faces that one camera view (11-parameter DLT) fits; it has to fit clearly best."""
    tried: list[tuple[float, list[LabelledPatch]]] = []
    for left, right in options:
        for row_l, column_l, row_r, column_r in product(left.rows, left.columns, right.rows, right.columns):
            labelled = [left.labelled(row_l, column_l), right.labelled(row_r, column_r)]
            tried.append((_misfit_px(labelled, blobs, target), labelled))
    tried.sort(key=lambda t: t[0])
    best, labelled = tried[0]
    pitch_px = _pitch_px(labelled, blobs, target)
    if best > _MISFIT * pitch_px:
        raise CheckFailedError(
            f"dots: the grids seen do not fit a view of a cube with two such faces (off by {best:.1f} px); check "
            f"margin_mm and pitch_mm in [target], or {_SEED_HINT}"
        )
    if len(tried) > 1 and tried[1][0] < _CLEARLY * best + 0.002 * pitch_px:
        raise CheckFailedError(
            f"dots: {sum(t[0] < _CLEARLY * best + 0.002 * pitch_px for t in tried)} ways to label the dots in view fit "
            f"equally well; move the target into view or {_SEED_HINT}"
        )
    return labelled


def _misfit_px(labelled: list[LabelledPatch], blobs: Blobs, target: GridTarget) -> float:
    points, pixels = [], []
    for part in labelled:
        stride = max(len(part.member) // _DOTS_FOR_GEOMETRY, 1)
        index = target.index(part.face, part.row[::stride], part.column[::stride])
        points.append(target.points_mm(index))
        pixels.append(blobs.xy_px[part.member[::stride]])
    return fit_dlt(np.concatenate(points), np.concatenate(pixels), "normalised").rms_px


def _pitch_px(labelled: list[LabelledPatch], blobs: Blobs, target: GridTarget) -> float:
    shape: FloatArray = np.median(np.concatenate([blobs.shape[p.member] for p in labelled]), axis=0)
    return float(np.linalg.det(shape) ** 0.25 * 2.0 * target.pitch_mm / target.dot_diameter_mm)
