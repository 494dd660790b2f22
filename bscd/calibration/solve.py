"""From labelled dots to a calibration: the reference volume, the virtual cameras, the control points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bscd.arrays import FloatArray
from bscd.calibration.calibration import Calibration, ControlPoints
from bscd.calibration.choices import CalibrationChoices
from bscd.calibration.lattice import Lattice, adjust_lattice
from bscd.calibration.maps import fit_smooth_map
from bscd.calibration.observations import View, with_nominal_rotation
from bscd.calibration.reference import Paired, corner_cameras, lattice_error_mm, pair_views, triangulate_pairs
from bscd.calibration.shifts import solve_shifts
from bscd.calibration.target import GridTarget
from bscd.errors import InputError

STAGE_TOLERANCE_MM = 0.006
STAGE_TOLERANCE_DEG = 0.02
_BIAS_DEGREE = 2
_EPIPOLAR_FLOOR_PX = 0.1
_EPIPOLAR_FACTOR = 4.0


def calibrate(
    reference_views: Sequence[View],
    bsc_views: Sequence[View],
    target: GridTarget,
    image_size_px: tuple[int, int],
    choices: CalibrationChoices | None = None,
    *,
    auxiliary_size_px: tuple[int, int] | None = None,
    origins: Mapping[str, str] | None = None,
    jack_mm: float = float("nan"),
    stage_sigma_mm: float = 0.0,
    stage_sigma_deg: float = 0.0,
) -> Calibration:
    """Calibrate the biprism system (DESIGN section 3.1 to 3.3).

    Parameters
    ----------
    reference_views
        Of "primary" and "auxiliary", prism lowered: the corner at POS.0 and the scan.
    bsc_views
        Of "left" and "right", prism raised: the same poses and positions.
    image_size_px, auxiliary_size_px
        (width, height) of the primary camera's images and of the auxiliary one's (None: the same).
    stage_sigma_mm, stage_sigma_deg
        One-sigma repeatability of the stages: how far the target may have been from where the readings say.

    Raises
    ------
    InputError
        Too few positions, a missing pose, or stage readings that differ between the two scans.
    """
    chosen = choices or CalibrationChoices()
    reference_views, bsc_views = with_nominal_rotation(reference_views), with_nominal_rotation(bsc_views)
    _check_positions(bsc_views, "biprism scan", chosen.degree)
    _check_positions(reference_views, "reference scan", 1)
    _check_stages(reference_views, bsc_views)
    pair = corner_cameras(reference_views, target, ("primary", "auxiliary"))
    virtual = corner_cameras(bsc_views, target, ("left", "right"))
    sizes_px = {"primary": image_size_px, "auxiliary": auxiliary_size_px or image_size_px}
    lattice = adjust_lattice(reference_views, target, image_size_px, auxiliary_size_px)
    standard = pair_views(reference_views, "primary", "auxiliary")
    standard_xyz = triangulate_pairs(standard, pair, "primary", "auxiliary", chosen.triangulation)
    standard_error = lattice_error_mm(standard.select(standard.face_pose), standard_xyz[standard.face_pose], target)
    seen = pair_views(bsc_views, "left", "right")
    if chosen.reference == "lattice":
        truth = lattice_points(lattice, seen, target)
        sigma = _lattice_sigma(lattice, seen, target)
    else:
        seen, truth = _raw_points(seen, standard, standard_xyz)
        sigma = _pinhole_bias(truth, lattice_points(lattice, seen, target))
    sigma = np.hypot(sigma, _stage_sigma(lattice, truth, seen.y_mm, stage_sigma_mm, stage_sigma_deg))
    distorted = triangulate_pairs(seen, virtual, "left", "right", chosen.triangulation)
    control = ControlPoints(
        seen.index, seen.position, seen.face_pose, seen.first_px, seen.second_px, truth, sigma, distorted
    )
    noise, limit = _noise(virtual["left"].matrix, virtual["right"].matrix, control, chosen)
    figures = {
        "standard_stereo_error_mean_mm": float(standard_error.mean()),
        "standard_stereo_error_std_mm": float(standard_error.std()),
        "standard_stereo_points": float(len(standard_error)),
        "left_dlt_rms_px": virtual["left"].rms_px,
        "right_dlt_rms_px": virtual["right"].rms_px,
        "primary_dlt_rms_px": pair["primary"].rms_px,
        "auxiliary_dlt_rms_px": pair["auxiliary"].rms_px,
        "primary_lattice_rms_px": lattice.rms_px["primary"],
        "auxiliary_lattice_rms_px": lattice.rms_px["auxiliary"],
        "map_residual_rms_px": noise,
        "control_points": float(len(truth)),
        "positions": float(len(np.unique(seen.position))),
    }
    limit = max(_EPIPOLAR_FLOOR_PX, limit)
    return Calibration(
        virtual["left"],
        virtual["right"],
        control,
        chosen,
        noise,
        limit,
        lattice.motion,
        sizes_px,
        pair,
        figures,
        dict(origins or {}),
        jack_mm,
        lattice.cameras,
    )


def lattice_points(lattice: Lattice, seen: Paired, target: GridTarget) -> FloatArray:
    """Lattice positions ``(N, 3)`` mm of paired dots at their own stage readings."""
    points = np.empty((len(seen.index), 3))
    motion = lattice.motion
    for face, reading in ((True, motion.face_reading_deg), (False, motion.corner_reading_deg)):
        here = seen.face_pose == face
        points[here] = motion.points_mm(target.points_mm(seen.index[here]), reading, seen.y_mm[here])
    return points


def _lattice_sigma(lattice: Lattice, seen: Paired, target: GridTarget) -> FloatArray:
    sigma = np.empty((len(seen.index), 3))
    for face in (True, False):
        here = seen.face_pose == face
        sigma[here] = lattice.sigma_mm(target.points_mm(seen.index[here]), face, seen.y_mm[here])
    return sigma


def _stage_sigma(
    lattice: Lattice, points: FloatArray, y_mm: FloatArray, sigma_mm: float, sigma_deg: float
) -> FloatArray:
    """What the stages' repeatability leaves open of the reference points, one sigma ``(N, 3)`` mm.

    Twice each: the target was placed anew in the reference scan and in the biprism scan.
    """
    motion = lattice.motion
    arm = points - motion.axis_point_mm - np.multiply.outer(y_mm, motion.direction)
    turned = np.cross(motion.axis, arm) * np.deg2rad(sigma_deg)
    return np.sqrt(2.0) * np.hypot(turned, motion.direction * sigma_mm)


def _raw_points(seen: Paired, standard: Paired, standard_xyz: FloatArray) -> tuple[Paired, FloatArray]:
    """The standard stereo's own points for the dots that both systems saw."""
    place = {key: row for row, key in enumerate(_keys(standard))}
    rows = np.array([place.get(key, -1) for key in _keys(seen)])
    return seen.select(rows >= 0), standard_xyz[rows[rows >= 0]]


def _keys(paired: Paired) -> list[tuple[int, int, bool]]:
    return list(zip(paired.index.tolist(), paired.position.tolist(), paired.face_pose.tolist(), strict=True))


def _pinhole_bias(raw: FloatArray, lattice: FloatArray) -> FloatArray:
    """How far the raw points lie from the lattice beyond their noise, rms per axis, ``(N, 3)`` mm.

    Their noise shows in the maps' residuals already; the pinhole's bias does not.
    """
    smooth = fit_smooth_map(raw, raw - lattice, _BIAS_DEGREE).shifts_px(raw)
    return np.broadcast_to(np.sqrt(np.mean(smooth**2, axis=0)), raw.shape).copy()


def _noise(
    left: FloatArray, right: FloatArray, control: ControlPoints, choices: CalibrationChoices
) -> tuple[float, float]:
    """Scatter (px rms) of the dots about the smooth maps, and the epipolar residual that calls the rig moved."""
    shifts = solve_shifts(left, right, control.left_px, control.right_px, control.reference_mm)
    smooth = fit_smooth_map(control.distorted_mm, shifts, choices.degree)
    per_axis = float(np.sqrt(np.trace(smooth.residual_covariance_px2) / 4.0))
    return per_axis, _EPIPOLAR_FACTOR * per_axis


def _check_positions(views: Sequence[View], name: str, degree: int) -> None:
    positions = {view.position for view in views if view.pose == "face"}
    needed = max(degree + 1, 2)
    if len(positions) < needed:
        raise InputError(
            f"{name}: the face was seen at {len(positions)} positions, maps of degree {degree} need at least "
            f"{needed}; scan more positions or lower [calibration] degree"
        )


def _check_stages(reference_views: Sequence[View], bsc_views: Sequence[View]) -> None:
    """Both scans must have been taken at the same stage readings: the prism must be all that changed."""
    reference = {(view.pose, view.position): view for view in reference_views}
    for view in bsc_views:
        other = reference.get((view.pose, view.position))
        if other is None:
            continue
        shifted, turned = view.y_mm - other.y_mm, view.rotation_deg - other.rotation_deg
        if abs(shifted) > STAGE_TOLERANCE_MM or abs(turned) > STAGE_TOLERANCE_DEG:
            raise InputError(
                f"the two scans do not belong together: at the {view.pose} pose, POS.{view.position:+d}, the stage "
                f"readings differ by {shifted:+.4f} mm and {turned:+.3f} deg; repeat one scan without re-mounting"
            )
