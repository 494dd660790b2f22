from .importing import ImportProgress, ImportResult, import_folder
from .means import FrameMean
from .names import AXES, CAMERAS, PHASES, AxisName, CameraName, Compression, PhaseName
from .problems import ImportRefusedError, Problem
from .reader import RunFile
from .records import (
    AxisMeta,
    CameraMeta,
    FrameLoss,
    FrameRecord,
    PressureMeta,
    RunEvent,
    RunHeader,
    RunState,
    TimeBase,
)
from .recovery import Recovery, is_unfinished, recover_in_place, recover_into
from .writer import RunWriter

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
    "is_unfinished",
    "recover_in_place",
    "recover_into",
]
