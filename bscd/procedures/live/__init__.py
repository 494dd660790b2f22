"""Results while frames arrive: the same as measuring the run afterwards, and never in the recorder's way."""

from bscd.procedures.live.follower import LiveFollower
from bscd.procedures.live.measurement import LiveMeasurement
from bscd.procedures.live.messages import LiveDone, LiveEvent, LiveFailure, LiveFrame, LiveSetup, LiveWarning

__all__ = [
    "LiveDone",
    "LiveEvent",
    "LiveFailure",
    "LiveFollower",
    "LiveFrame",
    "LiveMeasurement",
    "LiveSetup",
    "LiveWarning",
]
