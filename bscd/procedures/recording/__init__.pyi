from .ending import NotVentedError
from .inflation import record_inflation
from .recipes import InflationRecipe, SphereRecipe
from .result import Ending, Recording
from .sphere import record_sphere
from .storing import Storing

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
