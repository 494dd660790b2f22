"""A calibration of the biprism system: virtual cameras, control points and distortion maps, and its use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial import Delaunay, KDTree

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.calibration.choices import CalibrationChoices, Interpolant, ShiftSolver
from bscd.calibration.displacement import ImageCovariances, displacement_covariance
from bscd.calibration.dlt import DltCamera
from bscd.calibration.hull import Hull
from bscd.calibration.lens import LensCamera
from bscd.calibration.maps import DistortionMap, LinearMap, SmoothMap, fit_smooth_map
from bscd.calibration.motion import TargetMotion
from bscd.calibration.shifts import solve_shifts
from bscd.calibration.triangulation import Triangulated, triangulate


@dataclass(frozen=True)
class ControlPoints:
    """The control points of the distortion maps, M of them.

    ``reference_mm`` ``(M, 3)`` is P^T, ``reference_sigma_mm`` ``(M, 3)`` its uncertainty, ``distorted_mm``
    ``(M, 3)`` is P^DIST; ``left_px``, ``right_px`` ``(M, 2)`` the measured images, ``index`` ``(M,)`` the target's
    labels, ``position`` ``(M,)`` k of POS.k and ``face_pose`` ``(M,)`` whether seen in the face pose.
    """

    index: IntArray
    position: IntArray
    face_pose: BoolArray
    left_px: FloatArray
    right_px: FloatArray
    reference_mm: FloatArray
    reference_sigma_mm: FloatArray
    distorted_mm: FloatArray


@dataclass(frozen=True)
class Points3D:
    """Reconstructed points: ``xyz_mm`` ``(N, 3)`` world, ``sigma_mm`` ``(N, 3)``, ``inside`` ``(N,)`` the hull.

    ``epipolar_px`` ``(N,)`` is the distance between the images and those of the point, across the epipolar lines:
    large where left and right do not belong together or the rig has moved.
    """

    xyz_mm: FloatArray
    sigma_mm: FloatArray
    inside: BoolArray
    epipolar_px: FloatArray


@dataclass(frozen=True, eq=False)
class Located:
    """Triangulated points before their uncertainty: ``points`` (corrected or not) and where they came from.

    ``uncorrected_mm`` ``(N, 3)`` is where the distortion maps were looked up, ``inside`` ``(N,)`` the hull.
    """

    points: Triangulated
    uncorrected_mm: FloatArray
    inside: BoolArray
    corrected: bool


@dataclass(frozen=True)
class Calibration:
    """The biprism system's calibration (DESIGN section 3.2 and 3.3)."""

    left: DltCamera
    right: DltCamera
    control: ControlPoints
    choices: CalibrationChoices
    sigma_px: float
    """Standard uncertainty of a dot's image coordinate in the scan, from the fit's residuals."""
    epipolar_limit_px: float
    """The median epipolar residual of a frame above which the rig counts as moved."""
    motion: TargetMotion
    """The target's motion in the world frame, as the reference scan measured it."""
    image_size_px: Mapping[str, tuple[int, int]]
    """(width, height) of the images that it is for, by camera ("primary", "auxiliary")."""
    reference: Mapping[str, DltCamera] = field(default_factory=dict)
    """The standard stereo pair ("primary", "auxiliary")."""
    figures: Mapping[str, float] = field(default_factory=dict)
    """Residuals and errors of the calibration by name, units in the names."""
    origins: Mapping[str, str] = field(default_factory=dict)
    """Configuration text, uuids and checksums of the runs it came from, program version, times."""
    jack_mm: float = float("nan")
    """Height of the jacks during the biprism scan."""
    lenses: Mapping[str, LensCamera] = field(default_factory=dict)
    """The standard stereo pair as the lattice's adjustment found it, with its lenses."""

    @classmethod
    def load(cls, path: str | Path) -> Calibration:
        """Read a calibration file. Raises `InputError` when it is not one."""
        from bscd.calibration.storage import load_calibration

        return load_calibration(path)

    def save(self, path: str | Path) -> None:
        """Write it to a new HDF5 file. Raises `InputError` when the file exists."""
        from bscd.calibration.storage import save_calibration

        save_calibration(self, path)

    def choose(self, solver: ShiftSolver, interpolant: Interpolant) -> Calibration:
        """The same scans with another solver or interpolant."""
        return replace(self, choices=replace(self.choices, solver=solver, interpolant=interpolant))

    @cached_property
    def shifts_px(self) -> FloatArray:
        """The control points' shifts ``(M, 4)`` px: u_L, v_L, u_R, v_R."""
        control = self.control
        return solve_shifts(
            self.left.matrix,
            self.right.matrix,
            control.left_px,
            control.right_px,
            control.reference_mm,
            self.choices.solver,
            self.choices.triangulation,
        )

    @cached_property
    def maps(self) -> DistortionMap:
        """The four distortion maps over P^DIST."""
        smooth = self._smooth
        if self.choices.interpolant == "smooth":
            return smooth
        return LinearMap(Delaunay(self.control.distorted_mm), self.shifts_px, smooth)

    @cached_property
    def _smooth(self) -> SmoothMap:
        return fit_smooth_map(self.control.distorted_mm, self.shifts_px, self.choices.degree)

    @cached_property
    def checksum(self) -> str:
        """SHA-256 of what determines every reconstruction; results name their calibration by it."""
        from bscd.calibration.storage import calibration_checksum

        return calibration_checksum(self)

    def moved(self, points: Points3D) -> bool:
        """Whether a frame's corrected points say that camera or prism moved since the calibration.

        True when their median epipolar residual is above `epipolar_limit_px`, or when none was reconstructed.
        """
        known = points.epipolar_px[np.isfinite(points.epipolar_px)]
        return known.size == 0 or bool(np.median(known) > self.epipolar_limit_px)

    @cached_property
    def hull(self) -> Hull:
        """The calibrated volume, of uncorrected positions."""
        return Hull.around(self.control.distorted_mm)

    @cached_property
    def _reference_tree(self) -> KDTree:
        return KDTree(self.control.distorted_mm)

    def reconstruct(
        self,
        left_px: FloatArray,
        right_px: FloatArray,
        corrected: bool = True,
        *,
        extrapolate: bool = False,
        covariance_px2: FloatArray | None = None,
    ) -> Points3D:
        """World positions of points seen at ``left_px`` and ``right_px`` ``(N, 2)``.

        Triangulate, look the shifts up at that point, shift the images, triangulate again (DESIGN section 3.4).

        Parameters
        ----------
        corrected
            False: the virtual cameras alone.
        extrapolate
            True: also outside the calibrated hull, where points are NaN otherwise (``inside`` stays False).
        covariance_px2
            Of (left column, left row, right column, right row): ``(4, 4)`` or ``(N, 4, 4)``; by default that of
            the calibration's own dots.
        """
        located = self.locate(left_px, right_px, corrected, extrapolate=extrapolate)
        return self.describe(located, np.eye(4) * self.sigma_px**2 if covariance_px2 is None else covariance_px2)

    def locate(
        self, left_px: FloatArray, right_px: FloatArray, corrected: bool = True, *, extrapolate: bool = False
    ) -> Located:
        """The points of `reconstruct` with what their uncertainty follows from."""
        left, right = (np.asarray(image, np.float64).reshape(-1, 2) for image in (left_px, right_px))
        first = self._triangulate(left, right)
        known = np.isfinite(first.xyz_mm).all(axis=1)
        inside = np.zeros(len(left), bool)
        inside[known] = self.hull.contains(first.xyz_mm[known])
        if not corrected:
            return Located(first, first.xyz_mm, inside, corrected=False)
        use = known if extrapolate else inside
        shifts = np.full((len(left), 4), np.nan)
        if use.any():
            shifts[use] = self.maps.shifts_px(first.xyz_mm[use])
        second = self._triangulate(left + shifts[:, :2], right + shifts[:, 2:])
        return Located(second, first.xyz_mm, inside, corrected=True)

    def describe(self, located: Located, covariance_px2: FloatArray) -> Points3D:
        """Located points with their uncertainty, for image covariances ``(4, 4)`` or ``(N, 4, 4)`` px^2."""
        points = located.points
        if not located.corrected:
            sigma = _sigma(points.covariance_mm2(covariance_px2))
            return Points3D(points.xyz_mm, sigma, located.inside, _epipolar(points))
        known = np.asarray(np.isfinite(points.xyz_mm).all(axis=1))
        sigma = np.full(points.xyz_mm.shape, np.nan)
        if known.any():
            at = located.uncorrected_mm[known]
            per_point = covariance_px2 if np.ndim(covariance_px2) == 2 else covariance_px2[known]
            total = points.only(known).covariance_mm2(per_point + self.maps.covariance_px2(at))
            reference = self.control.reference_sigma_mm[self._reference_tree.query(at)[1]]
            sigma[known] = np.sqrt(_sigma(total) ** 2 + reference**2)
        return Points3D(points.xyz_mm, sigma, located.inside, _epipolar(points))

    def displacement_sigma_mm(self, now: Located, reference: Located, images: ImageCovariances) -> FloatArray:
        """Standard uncertainty ``(N, 3)`` of the displacement between two locations of the same points."""
        maps = None
        if now.corrected:
            known = np.isfinite(now.points.xyz_mm).all(axis=1) & np.isfinite(reference.points.xyz_mm).all(axis=1)
            maps = np.full((len(now.inside), 4, 4), np.nan)
            maps[known] = self.maps.difference_covariance_px2(
                now.uncorrected_mm[known], reference.uncorrected_mm[known]
            )
        return _sigma(displacement_covariance(now.points, reference.points, images, maps))

    def _triangulate(self, left: FloatArray, right: FloatArray) -> Triangulated:
        return triangulate([self.left.matrix, self.right.matrix], [left, right], self.choices.triangulation)


def _sigma(covariance: FloatArray) -> FloatArray:
    return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))


def _epipolar(points: Triangulated) -> FloatArray:
    """Two views leave one equation over: the residuals' length is the misfit across the epipolar lines."""
    return np.sqrt(np.sum(points.residual_px**2, axis=(1, 2)))
