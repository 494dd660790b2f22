"""What the rig does: home, align, scan, calibrate, validate; every procedure ends with its reason and at rest."""

from bscd.procedures.align import align_biprism, align_cameras
from bscd.procedures.align_items import AlignmentItem, AlignmentReport
from bscd.procedures.calibrate import calibrate_observations, calibrate_runs
from bscd.procedures.dry_run import DryRun, dry_run
from bscd.procedures.home import Homed, home
from bscd.procedures.observe import MissingInView, Observations, observe
from bscd.procedures.progress import PausableStop, ProcedureStoppedError, Progress, ProgressCallback
from bscd.procedures.recipes import ScanKind, ScanRecipe, ScanStep
from bscd.procedures.rig import Rig, RigNotReadyError
from bscd.procedures.scan import ScanResult, record_scan, recorded_steps, resume_scan
from bscd.procedures.validate import CalibrationCheck, check_calibration, record_validation, validate_run

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
