"""Maps of an inflation: displacement at several pressures (paper, figure 8), strain, uncertainty and residual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from bscd.analysis.figures.style import (
    ERROR_COLOURS,
    SHIFT_COLOURS,
    WIDTH_IN,
    draw_nothing,
    new_figure,
    panel_title,
    styled,
)
from bscd.analysis.figures.surface_map import limits_of, mark_apart, paint_map
from bscd.arrays import BoolArray, FloatArray

_LEFT_IN, _RIGHT_IN, _BOTTOM_IN, _TOP_IN = 0.95, 0.85, 0.55, 0.35
_GAP_IN = 0.14

#: A scale of its own leaves out the outermost points on either side; the rim's would take all of it.
_SHOWN_SHARE = 0.97


@dataclass(frozen=True, eq=False)
class MapRow:
    """One quantity at several states on one colour scale: ``values`` ``(K, N)``; ``signed`` scales lie about zero."""

    name: str
    unit: str
    values: FloatArray
    signed: bool = False
    contours: bool = True


@styled
def draw_map_rows(
    places_mm: FloatArray, rows: Sequence[MapRow], heads: Sequence[str], apart: Sequence[BoolArray]
) -> Figure:
    """A row a quantity, a column a state; places ``(N, 2)`` are x', y' in the reference, ``apart`` extrapolated."""
    if not rows or not any(np.isfinite(row.values).any() for row in rows):
        return draw_nothing("No point was measured.")
    side_in = min((WIDTH_IN - _LEFT_IN - _RIGHT_IN) / len(heads) - _GAP_IN, 2.4)
    width_in = _LEFT_IN + len(heads) * (side_in + _GAP_IN) + _RIGHT_IN
    height_in = _TOP_IN + _BOTTOM_IN + len(rows) * (side_in + _GAP_IN)
    figure = new_figure(height_in, max(width_in, 5.0))
    for down, row in enumerate(rows):
        scale = limits_of(row.values, symmetric=row.signed)
        colours = SHIFT_COLOURS if row.signed else ERROR_COLOURS
        ticks = np.asarray(MaxNLocator(9).tick_values(scale.vmin or 0.0, scale.vmax or 1.0), float)
        levels = ticks[np.abs(ticks) > 1e-9 * np.ptp(ticks)] if row.contours else None  # zero is along every rim
        bottom_in = height_in - _TOP_IN - (down + 1) * (side_in + _GAP_IN) + _GAP_IN
        for across, values in enumerate(row.values):
            left_in = _LEFT_IN + across * (side_in + _GAP_IN)
            axes = _panel(figure, left_in, bottom_in, side_in)
            paint_map(axes, places_mm, values, colours, scale, levels)
            mark_apart(axes, places_mm, apart[across])
            _frame(axes, places_mm, left=across == 0, bottom=down == len(rows) - 1)
            if down == 0:
                panel_title(axes, heads[across])
            if across == 0:
                axes.annotate(
                    row.name,
                    (-0.42, 0.5),
                    xycoords="axes fraction",
                    ha="center",
                    va="center",
                    rotation=90,
                    fontsize=10,
                    fontweight="bold",
                )
        cax = _panel(figure, _LEFT_IN + len(heads) * (side_in + _GAP_IN), bottom_in, side_in, 0.12)
        figure.colorbar(ScalarMappable(scale, colours), cax=cax).set_label(row.unit)
    return figure


@styled
def draw_own_scales(
    places_mm: FloatArray,
    panels: Sequence[tuple[str, str, FloatArray]],
    apart: BoolArray,
    *,
    names: tuple[str, str] = ("x' (mm)", "y' (mm)"),
) -> Figure:
    """Several quantities of one state side by side: (title, unit, values ``(N,)``), each on its own scale.

    ``names`` are the axes' labels, ``apart`` ``(N,)`` the extrapolated places.
    """
    count = len(panels)
    each_in = (WIDTH_IN - 0.25) / count
    side_in = each_in - 1.1
    figure = new_figure(side_in + 1.25)
    for place, (title, unit, values) in enumerate(panels):
        left_in = 0.58 + place * each_in
        axes = _panel(figure, left_in, 0.72, side_in)
        scale: Normalize = limits_of(values, share=_SHOWN_SHARE)
        paint_map(axes, places_mm, values, ERROR_COLOURS, scale)
        mark_apart(axes, places_mm, apart)
        _frame(axes, places_mm, left=place == 0, bottom=True, names=names)
        panel_title(axes, title)
        bar_axes = _panel(figure, left_in, 0.72, side_in, 0.1, shift_in=side_in + 0.06)
        figure.colorbar(ScalarMappable(scale, ERROR_COLOURS), cax=bar_axes, extend="both").set_label(unit, labelpad=2.0)
        known = values[np.isfinite(values)]
        if known.size:
            axes.set_xlabel(f"{names[0]}\nmedian {np.median(known):.3g}")
    return figure


def _panel(
    figure: Figure, left_in: float, bottom_in: float, height_in: float, width_in: float = 0.0, *, shift_in: float = 0.0
) -> Axes:
    """Axes at a place in inches; square without a width."""
    whole_width, whole_height = figure.get_size_inches()
    return figure.add_axes(
        (
            (left_in + shift_in) / whole_width,
            bottom_in / whole_height,
            (width_in or height_in) / whole_width,
            height_in / whole_height,
        )
    )


def _frame(
    axes: Axes, places_mm: FloatArray, *, left: bool, bottom: bool, names: tuple[str, str] = ("x' (mm)", "y' (mm)")
) -> None:
    """The same limits for every panel, labels at the left and at the bottom only."""
    known = places_mm[np.isfinite(places_mm).all(axis=1)]
    if len(known):
        middle, half = (known.max(axis=0) + known.min(axis=0)) / 2.0, 0.52 * float(np.ptp(known, axis=0).max())
        axes.set_xlim(middle[0] - half, middle[0] + half)
        axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.tick_params(labelleft=left, labelbottom=bottom, length=2.5)
    if left:
        axes.set_ylabel(names[1])
    if bottom:
        axes.set_xlabel(names[0])
