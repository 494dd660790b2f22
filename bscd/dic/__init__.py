"""Digital image correlation in the plane: where points of one image are in another, and how sure that is.

Pure numerics on arrays; `correlate` is the front door.
"""

from bscd.dic.correlate import correlate
from bscd.dic.correlation import Correlation, GuessSource, Status
from bscd.dic.grid import grid_points
from bscd.dic.images import PreparedImage, prepare
from bscd.dic.noise import ImageNoise, estimate_noise, noise_from_pair
from bscd.dic.speckle import SpeckleQuality, speckle_quality

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
