"""A quantity over measured points, as a map: filled where neighbours are measured, holes left open."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, Normalize
from matplotlib.tri import Triangulation
from scipy.spatial import Delaunay

from bscd.analysis.figures.style import ACCENT, INK
from bscd.analysis.surface.spacing import spread_over_area
from bscd.arrays import BoolArray, FloatArray, IntArray

#: A triangle is filled while its edges are this many point spacings at most.
_LONGEST_EDGE = 1.9


def triangles_between(places: FloatArray, there: BoolArray) -> IntArray:
    """Triangles ``(M, 3)`` between those of the places ``(N, 2)`` that are there, none across a hole."""
    index = np.flatnonzero(there & np.isfinite(places).all(axis=1))
    if not spread_over_area(places[index]):
        return np.zeros((0, 3), np.int64)
    corners = index[Delaunay(places[index]).simplices]
    longest = np.linalg.norm(places[corners] - places[np.roll(corners, 1, axis=1)], axis=2).max(axis=1)
    return corners[longest <= _LONGEST_EDGE / np.sqrt(2.0) * np.median(longest)].astype(np.int64)


def paint_map(
    axes: Axes,
    places: FloatArray,
    values: FloatArray,
    cmap: str | Colormap,
    norm: Normalize,
    levels: FloatArray | None = None,
) -> None:
    """Colour the surface of places ``(N, 2)`` by values ``(N,)``, NaN where not known; contours at ``levels``."""
    there = np.isfinite(values)
    corners = triangles_between(places, there)
    if len(corners):
        columns, rows = np.nan_to_num(places).T
        mesh = Triangulation(columns, rows, corners)
        filled = np.where(there, values, 0.0)
        axes.tripcolor(mesh, filled, cmap=cmap, norm=norm, shading="gouraud", rasterized=True)
        if levels is not None:
            low, high = values[corners].min(), values[corners].max()
            between = levels[(levels > low) & (levels < high)]
            if len(between):
                axes.tricontour(mesh, filled, levels=between, colors=INK, linewidths=0.5, alpha=0.6)
    axes.set_aspect("equal")


def mark_apart(axes: Axes, places: FloatArray, which: BoolArray) -> None:
    """Ring the places that were extrapolated, so that none passes for a measured one."""
    if which.any():
        axes.plot(
            *places[which].T,
            linestyle="none",
            marker="o",
            markersize=2.6,
            markerfacecolor="none",
            markeredgecolor=ACCENT,
            markeredgewidth=0.7,
            rasterized=True,
        )


def limits_of(values: FloatArray, *, symmetric: bool = False, share: float = 0.995) -> Normalize:
    """A colour scale for values, of any shape: all but the outermost; about zero where it is ``symmetric``."""
    known = values[np.isfinite(values)]
    if not known.size:
        return Normalize(-1.0 if symmetric else 0.0, 1.0)
    if symmetric:
        limit = max(float(np.quantile(np.abs(known), share)), 1e-12)
        return Normalize(-limit, limit)
    low, high = (float(value) for value in np.quantile(known, [1.0 - share, share]))
    return Normalize(low, high if high > low else low + 1e-12)
