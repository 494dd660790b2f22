"""Run files: recorded, imported and read back."""

from bscd.acquisition.importing import ImportProgress, ImportResult, import_folder
from bscd.acquisition.means import FrameMean
from bscd.acquisition.problems import ImportRefusedError, Problem
from bscd.acquisition.reader import RunFile
from bscd.acquisition.records import (
    AXES,
    CAMERAS,
    PHASES,
    AxisMeta,
    AxisName,
    CameraMeta,
    CameraName,
    FrameLoss,
    FrameRecord,
    PhaseName,
    PressureMeta,
    RunEvent,
    RunHeader,
    RunState,
)
from bscd.acquisition.writer import RunWriter

__all__ = [
    "AXES",
    "CAMERAS",
    "PHASES",
    "AxisMeta",
    "AxisName",
    "CameraMeta",
    "CameraName",
    "FrameLoss",
    "FrameMean",
    "FrameRecord",
    "ImportProgress",
    "ImportRefusedError",
    "ImportResult",
    "PhaseName",
    "PressureMeta",
    "Problem",
    "RunEvent",
    "RunFile",
    "RunHeader",
    "RunState",
    "RunWriter",
    "import_folder",
]
