"""Where a grid that is seen in part ends: the next dot would be in view, yet the face is bright there."""

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
_PROBES = 7


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
    """Look beyond the outermost dots of a patch, where the next dot's near half would be.

    ``limits_px`` ``(H, 2)``: first and last column of the view in each row.
    """
    radius = target.dot_diameter_mm / 2.0 / target.pitch_mm
    lattice = patch.lattice
    ground, dark = _levels(image, face_map, lattice, radius)
    level = np.median((ground + dark) / 2.0)
    probes = np.linspace(1.0 - 0.8 * radius, 1.0 - 0.2 * radius, _PROBES)
    seen = []
    for axis, sign in ((1, -1), (1, 1), (0, -1), (0, 1)):
        extreme = lattice[:, axis].min() if sign < 0 else lattice[:, axis].max()
        last = lattice[lattice[:, axis] == extreme]
        step = np.zeros(2)
        step[axis] = sign
        pixels = face_map.pixels(last[:, None] + probes[:, None] * step)
        grey = grey_at(image, pixels)
        row = np.clip(np.rint(pixels[..., 1]), 0, len(limits_px) - 1).astype(int)
        inside = (pixels[..., 0] >= limits_px[row, 0]) & (pixels[..., 0] <= limits_px[row, 1])
        bright = (np.isfinite(grey) & inside & (np.nan_to_num(grey) > level)).mean(axis=1) > 0.7
        seen.append(bool(bright.mean() >= _MAJORITY))
    return Ends(*seen)


def _levels(image: Image, face_map: FaceMap, lattice: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    """Grey of the face halfway between dots, and in the dots."""
    between = np.stack([grey_at(image, face_map.pixels(lattice + step)) for step in ((0.5, 0), (0, 0.5), (0.5, 0.5))])
    inside = grey_at(image, face_map.pixels(lattice))
    ground = np.nanmedian(between, axis=0) if np.isfinite(between).any() else inside
    return ground[np.isfinite(ground)], inside[np.isfinite(inside)]
