"""Calibration of the standard stereo pair and of the biprism's two virtual cameras; pure numerics.

Only `Calibration.load` and `Calibration.save` touch a file.
"""

from bscd.calibration.calibration import Calibration, CalibrationChoices, ControlPoints, Located, Points3D
from bscd.calibration.displacement import ImageCovariances, displacement_covariance
from bscd.calibration.dlt import DltCamera, fit_dlt
from bscd.calibration.epipolar import epipolar_curve
from bscd.calibration.lattice import Lattice, adjust_lattice
from bscd.calibration.motion import TargetMotion
from bscd.calibration.observations import View, with_nominal_rotation
from bscd.calibration.reference import corner_cameras, lattice_error_mm, pair_views, triangulate_pairs
from bscd.calibration.solve import calibrate
from bscd.calibration.target import GridTarget, PointsTarget
from bscd.calibration.triangulation import triangulate

__all__ = [
    "Calibration",
    "CalibrationChoices",
    "ControlPoints",
    "DltCamera",
    "GridTarget",
    "ImageCovariances",
    "Lattice",
    "Located",
    "Points3D",
    "PointsTarget",
    "TargetMotion",
    "View",
    "adjust_lattice",
    "calibrate",
    "corner_cameras",
    "displacement_covariance",
    "epipolar_curve",
    "fit_dlt",
    "lattice_error_mm",
    "pair_views",
    "triangulate",
    "triangulate_pairs",
    "with_nominal_rotation",
]
