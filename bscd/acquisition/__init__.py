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
    Compression,
    FrameLoss,
    FrameRecord,
    PhaseName,
    PressureMeta,
    RunEvent,
    RunHeader,
    RunState,
    TimeBase,
)
from bscd.acquisition.recovery import Recovery, recover_in_place, recover_into
from bscd.acquisition.writer import RunWriter

__all__ = [
    "AXES",
    "CAMERAS",
    "PHASES",
    "AxisMeta",
    "AxisName",
    "CameraMeta",
    "CameraName",
    "Compression",
    "FrameLoss",
    "FrameMean",
    "FrameRecord",
    "ImportProgress",
    "ImportRefusedError",
    "ImportResult",
    "PhaseName",
    "PressureMeta",
    "Problem",
    "Recovery",
    "RunEvent",
    "RunFile",
    "RunHeader",
    "RunState",
    "RunWriter",
    "TimeBase",
    "import_folder",
    "recover_in_place",
    "recover_into",
]
