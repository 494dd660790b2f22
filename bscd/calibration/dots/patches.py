"""Whole grids: linked patches filled up where their maps expect dots, without lines that do not belong."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from bscd.arrays import FloatArray, IntArray
from bscd.calibration.dots.candidates import Blobs
from bscd.calibration.dots.face_map import FaceMap, fit_face_map
from bscd.calibration.dots.links import SMALLEST, Patch, linked_patches

_MATCH = 0.15  # of the pitch, about a predicted place
_SPARSE = 0.5  # of the usual number of dots in a line: less does not count as one
_LINES_TO_CONTINUE = 5
_CONTINUES = 0.06  # of the pitch: how well a border line goes on from the others


def find_patches(blobs: Blobs, pitch_per_radius: float) -> list[Patch]:
    """All lattices among the blobs, largest first.

    Filled up with blobs that sit where their maps expect them, without border lines that do not belong.
    """
    patches = linked_patches(blobs, pitch_per_radius)
    taken = np.zeros(len(blobs), bool)
    for patch in patches:
        taken[patch.member] = True
    done = []
    for patch in patches:
        filled = _filled(patch, blobs, taken)
        taken[filled.member] = True
        done.append(_trimmed(filled, blobs))
    return sorted(done, key=lambda p: -len(p.member))


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
    near = ~line & (np.abs(patch.lattice[:, axis] - patch.lattice[line][0, axis]) <= _LINES_TO_CONTINUE)
    rest = patch.lattice[near]
    if len(np.unique(rest[:, axis])) < 3 or len(rest) < 2 * SMALLEST:
        return True
    face_map = fit_face_map(rest, blobs.xy_px[patch.member[near]], highest=2)
    places = patch.lattice[line]
    step = blobs.xy_px[patch.member[line]] - face_map.pixels(places)
    off = np.einsum("nij,nj->ni", np.linalg.inv(face_map.jacobian(places)), step)
    alike = _same_shape(face_map, places, blobs.shape[patch.member[line]], patch.keep(near, recount=False), blobs)
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
