from .calibration import Calibration, ControlPoints, Located, Points3D
from .choices import CalibrationChoices
from .displacement import ImageCovariances, displacement_covariance
from .dlt import DltCamera, fit_dlt
from .epipolar import epipolar_curve
from .lattice import Lattice, adjust_lattice
from .motion import TargetMotion
from .observations import View, with_nominal_rotation
from .reference import corner_cameras, lattice_error_mm, pair_views, triangulate_pairs
from .solve import calibrate
from .target import GridTarget, PointsTarget
from .triangulation import triangulate

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
