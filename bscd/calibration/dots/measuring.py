"""The dots of a labelled face: fitted, completed from the face's map, and held against their neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.calibration.dots.candidates import Blobs
from bscd.calibration.dots.ellipse import EllipseFits, fit_ellipses
from bscd.calibration.dots.face_map import FaceMap, fit_face_map
from bscd.calibration.dots.findings import Image, MissingDot
from bscd.calibration.dots.labelling import LabelledPatch
from bscd.calibration.dots.view import View2D
from bscd.calibration.target import GridTarget

_OFF_PLACE_PX = 0.25  # at least; or so many spreads:
_OFF_PLACE_SPREADS = 7.0
_DIRTY = 3.0  # times the usual residual of the fit
_DIRTY_SHARE = 0.03  # at least, of the dots' contrast
_TIGHT = 1.25  # the window of a second try, where something bounds the dot closely
_STRETCH = 0.15  # of the size that its neighbours have there
_PALE = 0.2  # of the usual depth
_SIGMAS = 5.0
_UNSURE_PX = 0.2  # a centre less sure than this is worth nothing
_FEWEST = 10


@dataclass(frozen=True)
class MeasuredFace:
    """A face's measured dots: ``index`` ``(N,)``, their ``lattice`` places ``(N, 2)``, the fits, the face's map."""

    face: int
    index: IntArray
    lattice: FloatArray
    fits: EllipseFits
    face_map: FaceMap
    missing: list[MissingDot]


@dataclass(frozen=True)
class _Usual:
    """What a dot of this face is like: residual of the fit and depth (grey levels)."""

    residual: float
    depth: float

    @property
    def dirty(self) -> float:
        """The residual above which something else than a dot is in the window."""
        return max(_DIRTY * self.residual, _DIRTY_SHARE * self.depth)


def measure_face(
    image: Image, part: LabelledPatch, blobs: Blobs, target: GridTarget, view: View2D, reach: float
) -> MeasuredFace:
    """Fit the labelled dots, then those that the map predicts and the search missed, and drop what does not fit.

    ``reach``: the size of the window in radii of the dot.
    """
    radius = target.dot_diameter_mm / 2.0 / target.pitch_mm
    lattice = np.stack([part.column, part.row], axis=-1).astype(np.float64)
    fits = fit_ellipses(image, blobs.xy_px[part.member], blobs.shape[part.member], view.limits_px, reach)
    usual = _usual(fits)
    face_map = fit_face_map(lattice, fits.xy_px, highest=3)
    rest = _unlabelled(lattice, target)
    places, shapes = face_map.pixels(rest), face_map.dot_shape(rest, radius)
    near = view.overlaps(places, shapes)
    later = fit_ellipses(image, places[near], shapes[near], view.limits_px, reach)
    searched = np.concatenate([np.zeros(len(fits), bool), np.ones(len(later), bool)])
    lattice, fits = np.concatenate([lattice, rest[near]]), fits.joined(later)
    soiled = np.flatnonzero(fits.residual > usual.dirty)
    fits = fits.replaced(soiled, fit_ellipses(image, fits.xy_px[soiled], fits.shape[soiled], view.limits_px, _TIGHT))
    for _ in range(2):
        sound = _faults(fits, lattice, searched, face_map, radius, view, usual) == ""
        if sound.sum() >= _FEWEST:
            face_map = fit_face_map(lattice[sound], fits.xy_px[sound])
    fault = _faults(fits, lattice, searched, face_map, radius, view, usual)
    kept = fault == ""
    absent = view.absence(places[~near], shapes[~near])
    missing = [
        _missing(target, part.face, place, face_map, str(why))
        for place, why in [*zip(lattice[~kept], fault[~kept], strict=True), *zip(rest[~near], absent, strict=True)]
    ]
    index = target.index(part.face, lattice[kept, 1].astype(np.int64), lattice[kept, 0].astype(np.int64))
    return MeasuredFace(part.face, index, lattice[kept], fits.keep(kept), face_map, missing)


def _usual(fits: EllipseFits) -> _Usual:
    """From the dots that the search found."""
    depth = fits.contrast * fits.ground
    residual = float(np.median(fits.residual[fits.fitted])) if fits.fitted.any() else 0.0
    return _Usual(residual, float(np.nanmedian(depth)))


def _unlabelled(lattice: FloatArray, target: GridTarget) -> FloatArray:
    free = np.ones((target.columns, target.rows), bool)
    free[tuple(lattice.astype(int).T)] = False
    return np.argwhere(free).astype(np.float64)


def _faults(
    fits: EllipseFits,
    lattice: FloatArray,
    searched: BoolArray,
    face_map: FaceMap,
    radius: float,
    view: View2D,
    usual: _Usual,
) -> np.ndarray:
    """Why each dot can not be used, ``(N,)`` text; empty for a good one.

    ``searched`` ``(N,)``: the map alone said where; there a centroid would always find something.
    """
    fault = np.full(len(fits), "", dtype=object)
    place, shape = face_map.pixels(lattice), face_map.dot_shape(lattice, radius)
    off = np.linalg.norm(fits.xy_px - place, axis=1)
    noise = _SIGMAS * fits.sigma_px
    limit = np.maximum(max(_OFF_PLACE_PX, _OFF_PLACE_SPREADS * face_map.spread_px), noise)
    stretch = np.sort(np.linalg.eigvals(np.linalg.inv(shape) @ np.nan_to_num(fits.shape)).real, axis=1)
    stretch = np.sqrt(np.maximum(stretch, 0.0))
    if (fits.fitted & ~searched).any():
        stretch /= np.median(stretch[fits.fitted & ~searched], axis=0)
    size_noise = noise / np.sqrt(np.linalg.eigvalsh(shape)[:, 0])
    fault[~(off < limit)] = "something else is where it should be"
    fault[(np.abs(stretch - 1.0).max(axis=1) > _STRETCH + size_noise) & fits.fitted] = "not seen as a dot of its size"
    fault[fits.residual > usual.dirty] = "not a clean dot (covered, dirty or out of focus)"
    fault[~(fits.contrast * fits.ground > _PALE * usual.depth)] = "too little contrast"
    fault[~(fits.sigma_px < _UNSURE_PX) | (searched & ~fits.fitted)] = "no dot is seen where it should be"
    cut = view.cut(np.where(fits.fitted[:, None], fits.xy_px, place), shape)
    return np.where(cut == "", fault, cut)


def _missing(target: GridTarget, face: int, place: FloatArray, face_map: FaceMap, reason: str) -> MissingDot:
    column, row = (int(v) for v in place)
    x, y = face_map.pixels(place)
    return MissingDot(int(target.index(face, row, column)), reason, (float(x), float(y)))
