from .correlation import Correlation, GuessSource, Status
from .correlator import correlate
from .grid import grid_points
from .images import PreparedImage, prepare
from .noise import ImageNoise, estimate_noise, noise_from_pair
from .speckle import SpeckleQuality, speckle_quality

__all__ = [
    "Correlation",
    "GuessSource",
    "ImageNoise",
    "PreparedImage",
    "SpeckleQuality",
    "Status",
    "correlate",
    "estimate_noise",
    "grid_points",
    "noise_from_pair",
    "prepare",
    "speckle_quality",
]
