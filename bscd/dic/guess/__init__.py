"""Initial guesses, the cheapest first: propagation, dense flow, matched features, search by ZNCC.

Each gives affine shape parameters ``(N, 6)`` (u, ux, uy, v, vx, vy), NaN where it knows nothing.
"""

from bscd.dic.guess.features import FeatureMatches
from bscd.dic.guess.flow import DenseFlow
from bscd.dic.guess.propagation import extrapolate, nearest_known, seed_points
from bscd.dic.guess.search import guess_by_search

__all__ = [
    "DenseFlow",
    "FeatureMatches",
    "extrapolate",
    "guess_by_search",
    "nearest_known",
    "seed_points",
]
