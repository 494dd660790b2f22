"""The dots of the target in one image: found, labelled, and measured to a hundredth of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import FloatArray, IntArray
from bscd.calibration.dots.candidates import Blobs, find_blobs
from bscd.calibration.dots.ellipse import EllipseFits, fit_ellipses
from bscd.calibration.dots.ends import find_ends
from bscd.calibration.dots.face_map import FaceMap, fit_face_map
from bscd.calibration.dots.findings import GridFinding, Image, MissingDot, Seed, SplitRegion
from bscd.calibration.dots.labelling import LabelledPatch, label
from bscd.calibration.dots.patches import find_patches
from bscd.calibration.dots.pixels import checked, full_scale
from bscd.calibration.dots.view import View2D
from bscd.calibration.observations import PoseName
from bscd.calibration.target import GridTarget
from bscd.errors import InputError

_ROUND_ENOUGH = 0.85
_OFF_PLACE_PX = 0.5  # at least; or so many spreads:
_OFF_PLACE_SPREADS = 8.0
_DIRTY = 4.0  # times the usual residual of the fit
_DIRTY_SHARE = 0.06  # at least, of the dots' contrast
_TIGHT = 1.25  # the window of a second try, where something bounds the dot closely
_SIZE_TOLERANCE = 0.35
_SATURATED_WARNING = 0.01
_CONTRAST_WARNING = 0.08
_TOO_FEW = 10
_PALE = 0.45  # of the usual depth below the surroundings


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
    if pose == "face":  # the other face's dots, smeared at grazing incidence, could pass for one more column
        blobs = blobs.keep(blobs.depth > _PALE * np.median(blobs.depth)) if len(blobs) else blobs
    patches = [p for p in find_patches(blobs, 1.0 / radius) if len(p.member) >= _TOO_FEW]
    maps = [fit_face_map(p.lattice, blobs.xy_px[p.member], 3) for p in patches]
    ends = [find_ends(image, view.limits_px, p, blobs, m, target) for p, m in zip(patches, maps, strict=True)]
    labelled = label(patches, ends, blobs, target, pose, seed)
    reach = min(2.0, 0.5 / radius, 0.9 * target.margin_mm / target.pitch_mm / radius)
    faces = [_measured(image, part, blobs, target, view, max(reach, 1.3)) for part in labelled]
    faces.sort(key=lambda f: f.face)
    return _finding(image, faces, target, radius)


def _blobs_in(image: Image, view: View2D) -> Blobs:
    first, last = view.columns
    blobs = find_blobs(image[:, first : last + 1])
    xy = blobs.xy_px + np.array([first, 0.0])
    inside = view.contains(xy) & (blobs.roundness > _ROUND_ENOUGH)
    return Blobs(xy, blobs.shape, blobs.area_px, blobs.roundness, blobs.depth).keep(inside)


@dataclass(frozen=True)
class _Face:
    """A face's measured dots: ``index``, where the fits are, the face's map and what is missing."""

    face: int
    index: IntArray
    lattice: FloatArray
    fits: EllipseFits
    face_map: FaceMap
    missing: list[MissingDot]


def _measured(image: Image, part: LabelledPatch, blobs: Blobs, target: GridTarget, view: View2D, reach: float) -> _Face:
    """Fit the labelled dots, then those that the map predicts and the search missed, and drop what does not fit."""
    radius = target.dot_diameter_mm / 2.0 / target.pitch_mm
    lattice = np.stack([part.column, part.row], axis=-1).astype(np.float64)
    fits = fit_ellipses(image, blobs.xy_px[part.member], blobs.shape[part.member], view.limits_px, reach)
    face_map = fit_face_map(lattice, fits.xy_px, highest=3)
    rest = _unlabelled(lattice, target)
    places, shapes = face_map.pixels(rest), face_map.dot_shape(rest, radius)
    near = view.overlaps(places, shapes)
    later = fit_ellipses(image, places[near], shapes[near], view.limits_px, reach)
    lattice, fits = np.concatenate([lattice, rest[near]]), fits.joined(later)
    soiled = np.flatnonzero(fits.residual > _dirty_residual(fits))
    fits = fits.replaced(soiled, fit_ellipses(image, fits.xy_px[soiled], fits.shape[soiled], view.limits_px, _TIGHT))
    sound = ~_faults(fits, lattice, face_map, radius, view).astype(bool)
    if sound.sum() >= _TOO_FEW:
        face_map = fit_face_map(lattice[sound], fits.xy_px[sound])
    fault = _faults(fits, lattice, face_map, radius, view)
    kept = fault == ""
    missing = [
        _missing(target, part.face, place, face_map, str(why))
        for place, why in zip(lattice[~kept], fault[~kept], strict=True)
    ]
    reasons = view.absence(places[~near], shapes[~near])
    missing += [
        _missing(target, part.face, place, face_map, why) for place, why in zip(rest[~near], reasons, strict=True)
    ]
    index = target.index(part.face, lattice[kept, 1].astype(np.int64), lattice[kept, 0].astype(np.int64))
    return _Face(part.face, index, lattice[kept], fits.keep(kept), face_map, missing)


def _unlabelled(lattice: FloatArray, target: GridTarget) -> FloatArray:
    free = np.ones((target.columns, target.rows), bool)
    free[tuple(lattice.astype(int).T)] = False
    return np.argwhere(free).astype(np.float64)


def _faults(fits: EllipseFits, lattice: FloatArray, face_map: FaceMap, radius: float, view: View2D) -> np.ndarray:
    """Why each dot can not be used, ``(N,)`` text; empty for a good one."""
    fault = np.full(len(fits), "", dtype=object)
    place, shape = face_map.pixels(lattice), face_map.dot_shape(lattice, radius)
    off = np.linalg.norm(fits.xy_px - place, axis=1)
    limit = max(_OFF_PLACE_PX, _OFF_PLACE_SPREADS * face_map.spread_px)
    size = np.sqrt(np.abs(np.linalg.det(fits.shape)) / np.linalg.det(shape))
    usual = np.nanmedian(size)
    depth = fits.contrast * fits.ground
    fault[~(off < limit)] = "something else is where it should be"
    fault[~(np.abs(size / usual - 1.0) < _SIZE_TOLERANCE)] = "not seen as a dot of its size"
    fault[fits.residual > _dirty_residual(fits)] = "not a clean dot (covered, dirty or out of focus)"
    fault[~(depth > 0.2 * np.nanmedian(depth))] = "too little contrast"
    cut = view.cut(np.where(fits.fitted[:, None], fits.xy_px, place), shape)
    return np.where(cut == "", fault, cut)


def _dirty_residual(fits: EllipseFits) -> float:
    """The residual (grey levels) above which something else than a dot is in the window."""
    usual = np.nanmedian(fits.residual) if fits.fitted.any() else 0.0
    return float(max(_DIRTY * usual, _DIRTY_SHARE * np.nanmedian(fits.contrast * fits.ground)))


def _missing(target: GridTarget, face: int, place: FloatArray, face_map: FaceMap, reason: str) -> MissingDot:
    column, row = (int(v) for v in place)
    x, y = face_map.pixels(place)
    return MissingDot(int(target.index(face, row, column)), reason, (float(x), float(y)))


def _finding(image: Image, faces: list[_Face], target: GridTarget, radius: float) -> GridFinding:
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
