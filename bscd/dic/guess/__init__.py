"""Initial guesses, the cheapest first: propagation, dense flow, matched features, search by ZNCC.

Each gives affine shape parameters ``(N, 6)`` (u, ux, uy, v, vx, vy), NaN where it knows nothing.
"""

from bscd.dic.guess.features import guess_by_features
from bscd.dic.guess.flow import guess_by_flow
from bscd.dic.guess.propagation import extrapolate, nearest_known, seed_points
from bscd.dic.guess.search import guess_by_search

__all__ = [
    "extrapolate",
    "guess_by_features",
    "guess_by_flow",
    "guess_by_search",
    "nearest_known",
    "seed_points",
]
