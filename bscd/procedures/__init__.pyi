from .align import align_biprism, align_cameras
from .align_items import AlignmentItem, AlignmentReport
from .calibrate import calibrate_observations, calibrate_runs
from .homing import Homed, home
from .observing import MissingInView, Observations, observe
from .progress import PausableStop, ProcedureStoppedError, Progress, ProgressCallback
from .recipes import ScanKind, ScanRecipe, ScanStep
from .rehearsal import DryRun, dry_run
from .rig import Rig, RigNotReadyError
from .scan import ScanResult, record_scan, recorded_steps, resume_scan
from .validate import CalibrationCheck, check_calibration, record_validation, validate_run

__all__ = [
    "AlignmentItem",
    "AlignmentReport",
    "CalibrationCheck",
    "DryRun",
    "Homed",
    "MissingInView",
    "Observations",
    "PausableStop",
    "ProcedureStoppedError",
    "Progress",
    "ProgressCallback",
    "Rig",
    "RigNotReadyError",
    "ScanKind",
    "ScanRecipe",
    "ScanResult",
    "ScanStep",
    "align_biprism",
    "align_cameras",
    "calibrate_observations",
    "calibrate_runs",
    "check_calibration",
    "dry_run",
    "home",
    "observe",
    "record_scan",
    "record_validation",
    "recorded_steps",
    "resume_scan",
    "validate_run",
]
