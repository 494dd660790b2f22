"""Results while frames arrive: the same as measuring the run afterwards, and never in the recorder's way."""

from bscd.procedures.live.follower import LiveFollower
from bscd.procedures.live.measurement import LiveMeasurement
from bscd.procedures.live.messages import (
    LiveCatchingUp,
    LiveDone,
    LiveEvent,
    LiveFailure,
    LiveFrame,
    LiveSetup,
    LiveWarning,
)
from bscd.procedures.live.recording import LiveOutcome, record_and_measure

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
