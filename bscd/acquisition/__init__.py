"""Run files: recorded, imported and read back."""

from bscd.acquisition.means import FrameMean
from bscd.acquisition.reader import RunFile
from bscd.acquisition.records import (
    AXES,
    CAMERAS,
    PHASES,
    AxisMeta,
    AxisName,
    CameraMeta,
    CameraName,
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
    "FrameMean",
    "FrameRecord",
    "PhaseName",
    "PressureMeta",
    "RunEvent",
    "RunFile",
    "RunHeader",
    "RunState",
    "RunWriter",
]
