"""Trees of neighbours that are asked once or twice."""

from __future__ import annotations

from scipy.spatial import KDTree

from bscd.arrays import FloatArray


def quick_tree(points_px: FloatArray) -> KDTree:
    """A tree of points ``(N, 2)``, built in a third of the time; as quick to ask as another where they lie evenly."""
    return KDTree(points_px, balanced_tree=False, compact_nodes=False)
