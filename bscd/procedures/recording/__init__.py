"""Recording what is measured: a sphere at rest, and an inflation; both end safely however they end."""

from bscd.procedures.recording.ending import NotVentedError
from bscd.procedures.recording.inflation import record_inflation
from bscd.procedures.recording.recipes import InflationRecipe, SphereRecipe
from bscd.procedures.recording.result import Ending, Recording
from bscd.procedures.recording.sphere import record_sphere
from bscd.procedures.recording.storing import Storing

__all__ = [
    "Ending",
    "InflationRecipe",
    "NotVentedError",
    "Recording",
    "SphereRecipe",
    "Storing",
    "record_inflation",
    "record_sphere",
]
