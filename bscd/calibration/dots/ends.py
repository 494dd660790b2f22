"""Where a grid that is seen in part ends: the next dot would be in view, yet the face goes on without it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration.dots.candidates import Blobs
from bscd.calibration.dots.face_map import FaceMap
from bscd.calibration.dots.findings import Image
from bscd.calibration.dots.links import Patch
from bscd.calibration.dots.pixels import grey_at
from bscd.calibration.target import GridTarget

_MAJORITY = 0.6
_PROBES = 11
_SAME_GROUND = 0.25  # of the dots' depth: the face itself, not what is behind it


@dataclass(frozen=True)
class Ends:
    """On which sides a patch shows the end of the grid."""

    top: bool
    bottom: bool
    left: bool
    right: bool


def find_ends(
    image: Image, limits_px: FloatArray, patch: Patch, blobs: Blobs, face_map: FaceMap, target: GridTarget
) -> Ends:
    """Look beyond the outermost dots of a patch, from the gap to where the next dot's near half would be.

    The grid ends there if all of that is as bright as the face between the last two dots.

    ``limits_px`` ``(H, 2)``: first and last column of the view in each row.
    """
    radius = target.dot_diameter_mm / 2.0 / target.pitch_mm
    lattice = patch.lattice
    ground, dark = _levels(image, face_map, lattice, radius)
    depth = float(np.median(ground) - np.median(dark))
    seen = []
    for axis, sign in ((1, -1), (1, 1), (0, -1), (0, 1)):
        farthest = 1.0 - 0.2 * radius
        if axis == 0:
            farthest = min(farthest, 0.95 * target.margin_mm / target.pitch_mm)
        if farthest < 1.0 - 0.7 * radius:  # the face may end before the next dot would begin
            seen.append(False)
            continue
        probes = np.linspace(0.5, farthest, _PROBES)
        extreme = lattice[:, axis].min() if sign < 0 else lattice[:, axis].max()
        last = lattice[lattice[:, axis] == extreme]
        step = np.zeros(2)
        step[axis] = sign
        pixels = face_map.pixels(last[:, None] + probes[:, None] * step)
        grey = grey_at(image, pixels)
        row = np.clip(np.rint(pixels[..., 1]), 0, len(limits_px) - 1).astype(int)
        inside = (pixels[..., 0] >= limits_px[row, 0]) & (pixels[..., 0] <= limits_px[row, 1])
        between = grey_at(image, face_map.pixels(last - 0.5 * step))
        alike = np.abs(np.nan_to_num(grey, nan=-np.inf) - between[:, None]) < _SAME_GROUND * depth
        goes_on = (alike & inside).mean(axis=1) > 0.8
        seen.append(bool(goes_on.mean() >= _MAJORITY))
    return Ends(*seen)


def _levels(image: Image, face_map: FaceMap, lattice: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    """Grey of the face halfway between dots, and in the dots."""
    between = np.stack([grey_at(image, face_map.pixels(lattice + step)) for step in ((0.5, 0), (0, 0.5), (0.5, 0.5))])
    inside = grey_at(image, face_map.pixels(lattice))
    ground = np.nanmedian(between, axis=0) if np.isfinite(between).any() else inside
    return ground[np.isfinite(ground)], inside[np.isfinite(inside)]
