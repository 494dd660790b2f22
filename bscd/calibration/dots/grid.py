"""The dots of the target in one image: found, labelled, and measured to a hundredth of a pixel."""

from __future__ import annotations

import numpy as np

from bscd.calibration.dots.candidates import Blobs, find_blobs
from bscd.calibration.dots.ends import find_ends
from bscd.calibration.dots.face_map import fit_face_map
from bscd.calibration.dots.findings import GridFinding, Image, Seed, SplitRegion
from bscd.calibration.dots.labelling import label
from bscd.calibration.dots.measuring import MeasuredFace, measure_face
from bscd.calibration.dots.patches import find_patches
from bscd.calibration.dots.pixels import checked, full_scale
from bscd.calibration.dots.view import View2D
from bscd.calibration.observations import PoseName
from bscd.calibration.target import GridTarget
from bscd.errors import InputError

_ROUND_ENOUGH = 0.85
_SATURATED_WARNING = 0.01
_CONTRAST_WARNING = 0.08
_TOO_FEW = 10


def find_grid(
    image: Image, target: GridTarget, pose: PoseName, *, region: SplitRegion | None = None, seed: Seed | None = None
) -> GridFinding:
    """Find, label and measure the dots of the cube in one image, or in one half of a biprism image.

    Parameters
    ----------
    image
        ``(H, W)``, uint8, uint16 or float; dots dark on bright; the camera upright within about 20 degrees.
    target
        The cube's grid.
    pose
        "corner": both faces, the edge between them; "face": face 0 towards the camera, only it is labelled.
    region
        The half of a biprism image to look in.
    seed
        A dot whose label is known, where the grid is seen in part and its ends are not.

    Raises
    ------
    CheckFailedError
        No grid, another grid than the target's, or labels that can not be determined.
    InputError
        An image or seed that can not be used.
    """
    image = checked(image)
    if target.dot_diameter_mm >= 0.8 * target.pitch_mm:
        raise InputError(
            "[target] dot_diameter_mm: dots this large touch; pitch_mm has to be 1.25 times as much or more"
        )
    view = View2D.of(image.shape, region)
    radius = target.dot_diameter_mm / 2.0 / target.pitch_mm
    blobs = _blobs_in(image, view)
    patches = [p for p in find_patches(blobs, 1.0 / radius) if len(p.member) >= _TOO_FEW]
    maps = [fit_face_map(p.lattice, blobs.xy_px[p.member], 3) for p in patches]
    ends = [find_ends(image, view.limits_px, p, blobs, m, target) for p, m in zip(patches, maps, strict=True)]
    labelled = label(patches, ends, blobs, target, pose, seed)
    reach = min(2.0, 0.5 / radius, 0.9 * target.margin_mm / target.pitch_mm / radius)
    faces = [measure_face(image, part, blobs, target, view, max(reach, 1.3)) for part in labelled]
    faces.sort(key=lambda f: f.face)
    return _finding(image, faces, target, radius)


def _blobs_in(image: Image, view: View2D) -> Blobs:
    first, last = view.columns
    blobs = find_blobs(image[:, first : last + 1])
    xy = blobs.xy_px + np.array([first, 0.0])
    inside = view.contains(xy) & (blobs.roundness > _ROUND_ENOUGH)
    return Blobs(xy, blobs.shape, blobs.area_px, blobs.roundness, blobs.depth).keep(inside)


def _finding(image: Image, faces: list[MeasuredFace], target: GridTarget, radius: float) -> GridFinding:
    index = np.concatenate([f.index for f in faces])
    xy = np.concatenate([f.fits.xy_px - f.face_map.centre_shift(f.lattice, radius) for f in faces])
    sigma = np.concatenate([f.fits.sigma_px for f in faces])
    order = np.argsort(index)
    missing = sorted((m for f in faces for m in f.missing), key=lambda m: m.index)
    saturated = float(np.mean(np.concatenate([f.fits.saturated for f in faces])))
    depth = float(np.median(np.concatenate([f.fits.contrast * f.fits.ground for f in faces])))
    warnings = []
    if saturated > _SATURATED_WARNING:
        warnings.append(f"{saturated:.0%} of the pixels around the dots are saturated; shorten the exposure")
    if depth < _CONTRAST_WARNING * full_scale(image):
        warnings.append(f"the dots' contrast is only {depth / full_scale(image):.0%} of full scale; more light")
    coarse = int(sum((~f.fits.fitted).sum() for f in faces))
    if coarse:
        warnings.append(f"{coarse} dots could only be measured by their grey-weighted centroid")
    return GridFinding(index[order], xy[order], sigma[order], tuple(missing), saturated, tuple(warnings))
