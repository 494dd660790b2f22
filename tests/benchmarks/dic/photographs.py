"""MultiDIC's photographs of a speckled cylinder: its own matches (Ncorr) beside ours, and what both reconstruct."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import h5py
import numpy as np
from scipy.io import loadmat
from scipy.optimize import least_squares

from bscd.arrays import BoolArray, FloatArray
from bscd.calibration import epipolar_curve, triangulate
from bscd.dic import PreparedImage, prepare
from bscd.dic.solver import ShapeName
from bscd.dic.stereo import match_views
from bscd.dic.tracking import Tracker, TrackingSettings

LEFT, RIGHT = 201, 202
FRAMES = range(1, 6)

#: A square of as many pixels as Ncorr's circle of radius 21 px.
SUBSET_PX = 37

#: Radius of the calibration cylinder; the speckled one has the same (docs/photographs.md).
RADIUS_MM = 57.0

#: How far beyond the calibration's marks the surface may be.
_BEYOND_MM = 5.0

Positions = Mapping[tuple[int, int], FloatArray]
"""Where the points are ``(N, 2)`` px, by camera and frame; NaN where they were not found."""


@dataclass(frozen=True)
class Cylinder:
    """A cylinder fitted to a surface: its radius, and the standard deviation of the points from it."""

    radius_mm: float
    std_mm: float
    off_mm: FloatArray
    angle_deg: FloatArray
    along_mm: FloatArray


@dataclass(frozen=True, eq=False)
class Photographs:
    """Both cameras' DLT ``(3, 4)``, depths of the calibrated volume, MultiDIC's region of interest and its matches.

    MultiDIC counts pixels from 1; here they count from 0. Its subsets end where the region ends, and so do ours.
    """

    folder: Path
    region: BoolArray
    matrices: Mapping[int, FloatArray]
    depths_mm: FloatArray
    stored: Positions

    @classmethod
    def load(cls, folder: Path) -> Photographs:
        """Read what MultiDIC left in a folder of real images."""
        matrices, depths = {}, []
        for camera in (LEFT, RIGHT):
            path = folder / f"multidic-dlt/DLTstruct_cam_{camera}.mat"
            data = loadmat(path, simplify_cells=True)["DLTstructCam"]
            matrices[camera] = np.append(np.ravel(data["DLTparams"]), 1.0).reshape(3, 4)
            depths.append(data["C3Dtrue"][:, np.asarray(data["columns"], int) - 1, 1])
        y = np.concatenate([each.ravel() for each in depths])
        with h5py.File(folder / "multidic-speckle/DIC2DpairResults_C_201_C_202.mat") as file:
            cells = [file[cell][()].T - 1.0 for cell in file["DIC2DpairResults/Points"][()].ravel()]
        stored = dict(zip([(camera, k) for camera in (LEFT, RIGHT) for k in FRAMES], cells, strict=True))
        region = loadmat(folder / "multidic-speckle/ROIMask_C_201_C_202.mat")["ROImask"] > 0
        return cls(folder, region, matrices, np.linspace(y.min() - _BEYOND_MM, y.max() + _BEYOND_MM, 81), stored)

    @property
    def points_px(self) -> FloatArray:
        """The points of the left camera's first photograph that MultiDIC has matched, ``(N, 2)``."""
        return self.stored[LEFT, FRAMES[0]]

    def grey(self, camera: int, frame: int) -> FloatArray:
        """A photograph, ``(3280, 2464)`` grey levels."""
        image = cv2.imread(str(self.folder / f"multidic-speckle/{camera}/{camera}_{frame}.jpg"), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        return np.asarray(image, np.float32)

    def curve(self, left_px: FloatArray) -> FloatArray:
        """Where points ``(n, 2)`` may be in the right camera, ``(n, K, 2)``."""
        return epipolar_curve(self.matrices[LEFT], self.matrices[RIGHT], left_px, self.depths_mm)

    def matched(self, shape: ShapeName = "affine", subset_px: int = SUBSET_PX, frames: int = len(FRAMES)) -> Positions:
        """Our matches: right from left in the first frame, then each camera's points through the others."""

        def view(camera: int, frame: int) -> PreparedImage:
            mask = self.region if (camera, frame) == (LEFT, FRAMES[0]) else None
            return prepare(self.grey(camera, frame), mask=mask, subset_px=subset_px)

        first = {camera: view(camera, FRAMES[0]) for camera in (LEFT, RIGHT)}
        start = self.points_px
        stereo = match_views(first[LEFT], first[RIGHT], start, self.curve, subset_px=subset_px, shape=shape)
        found = {(LEFT, FRAMES[0]): start, (RIGHT, FRAMES[0]): start + stereo.displacement_px}
        for camera in (LEFT, RIGHT):
            known = stereo.valid | (camera == LEFT)
            settings = TrackingSettings(subset_px=subset_px, shape=shape)
            tracker = Tracker(first[camera], found[camera, FRAMES[0]][known], settings)
            for frame in FRAMES[1:frames]:
                found[camera, frame] = np.full_like(start, np.nan)
                found[camera, frame][known] = tracker.track(view(camera, frame)).position_px
        return found

    def surface(self, positions: Positions, frame: int) -> FloatArray:
        """Points ``(N, 3)`` mm in a frame, by the DLT as it is; the lenses' distortion stays in."""
        pair = [positions[camera, frame] for camera in (LEFT, RIGHT)]
        return triangulate([self.matrices[camera] for camera in (LEFT, RIGHT)], pair).xyz_mm

    def marks_mm(self) -> FloatArray:
        """The calibration cylinder's marks in the columns that both cameras saw, by the same DLT, ``(M, 3)``."""
        seen = {}
        for camera in (LEFT, RIGHT):
            path = self.folder / f"multidic-dlt/DLTstruct_cam_{camera}.mat"
            data = loadmat(path, simplify_cells=True)["DLTstructCam"]
            columns = np.asarray(data["columns"], int).tolist()
            centroids = np.asarray(data["imageCentroids"], float).reshape(len(columns), -1, 2)
            seen[camera] = dict(zip(columns, centroids, strict=True))
        both = sorted(seen[LEFT].keys() & seen[RIGHT].keys())
        pair = [np.concatenate([seen[camera][column] for column in both]) for camera in (LEFT, RIGHT)]
        return triangulate([self.matrices[camera] for camera in (LEFT, RIGHT)], pair).xyz_mm


def apart_px(one: FloatArray, other: FloatArray) -> FloatArray:
    """Distances of positions ``(N, 2)`` that both are known."""
    distance = np.linalg.norm(one - other, axis=1)
    return distance[np.isfinite(distance)]


def fit_cylinder(xyz_mm: FloatArray) -> Cylinder:
    """The cylinder of least squares, its axis near z, through points ``(N, 3)``; those that are NaN are left out."""
    points = xyz_mm[np.isfinite(xyz_mm).all(axis=1)]
    middle = points[:, 2].mean()

    def split(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        axis = np.array([parameters[2], parameters[3], 1.0])
        axis /= np.linalg.norm(axis)
        from_axis = points - (parameters[0], parameters[1], middle)
        along = from_axis @ axis
        return from_axis - along[:, None] * axis, along

    def off(parameters: FloatArray) -> FloatArray:
        return np.linalg.norm(split(parameters)[0], axis=1) - parameters[4]

    best = least_squares(off, [0.0, 0.0, 0.0, 0.0, RADIUS_MM]).x
    outward, along = split(best)
    residual = off(best)
    angle = np.degrees(np.arctan2(outward[:, 0], outward[:, 1]))
    return Cylinder(float(best[4]), float(residual.std()), residual, angle, along)


def rigid_residual_mm(before_mm: FloatArray, after_mm: FloatArray) -> FloatArray:
    """What a rigid motion leaves of the displacements of points ``(N, 3)``, ``(n, 3)`` for those known in both."""
    known = np.isfinite(before_mm + after_mm).all(axis=1)
    one, other = before_mm[known], after_mm[known]
    u, _, vt = np.linalg.svd((one - one.mean(axis=0)).T @ (other - other.mean(axis=0)))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return other - other.mean(axis=0) - (one - one.mean(axis=0)) @ turn
