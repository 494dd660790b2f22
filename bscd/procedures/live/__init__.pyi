from .follower import LiveFollower
from .measurement import LiveMeasurement
from .messages import (
    LiveCatchingUp,
    LiveDone,
    LiveEvent,
    LiveFailure,
    LiveFrame,
    LiveSetup,
    LiveWarning,
)
from .recording import LiveOutcome, record_and_measure

__all__ = [
    "LiveCatchingUp",
    "LiveDone",
    "LiveEvent",
    "LiveFailure",
    "LiveFollower",
    "LiveFrame",
    "LiveMeasurement",
    "LiveOutcome",
    "LiveSetup",
    "LiveWarning",
    "record_and_measure",
]
