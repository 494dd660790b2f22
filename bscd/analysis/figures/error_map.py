"""The error d over the target at POS.0 before and after correction (paper, figure 4)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from bscd.analysis.figures.style import ERROR_COLOURS, INK, MISSING, WIDTH_IN, new_figure, panel_title, styled
from bscd.analysis.validation import Validation
from bscd.arrays import FloatArray
from bscd.calibration import GridTarget

_MAX_HEIGHT_IN = 3.4
_LEFT_IN, _BOTTOM_IN, _TOP_IN = 0.62, 0.72, 0.36
_GAP_IN, _BAR_IN, _AFTER_BAR_IN = 0.25, 0.14, 0.95


@styled
def draw_error_map(pos0: Validation, target: GridTarget) -> Figure:
    """Before and after on one colour scale, and after on its own; one square a dot, in micrometres."""
    before, after = 1e3 * pos0.error_mm("uncorrected"), 1e3 * pos0.error_mm("corrected")
    common, own = Normalize(0.0, _top(before)), Normalize(0.0, _top(after))
    around_in = _LEFT_IN + _GAP_IN + 2 * _AFTER_BAR_IN
    panel_in = min((WIDTH_IN - around_in) / 3, panel_width_in(pos0, target, _MAX_HEIGHT_IN))
    height_in = panel_in / panel_width_in(pos0, target, 1.0)
    figure = new_figure(_BOTTOM_IN + height_in + _TOP_IN, max(around_in + 3 * panel_in, 7.0))
    left_in = _LEFT_IN
    for error, scale, title, bar in (
        (before, common, "Before correction", False),
        (after, common, "After, same scale", True),
        (after, own, "After, own scale", True),
    ):
        axes = add_panel(figure, left_in, panel_in, height_in)
        drawn = paint_dots(axes, pos0, target, error, scale)
        panel_title(axes, title)
        axes.set_xlabel("along the target (mm)\n" + mean_and_scatter_um(error))
        left_in += panel_in + (_AFTER_BAR_IN if bar else _GAP_IN)
        if bar:
            cax = add_panel(figure, left_in - _AFTER_BAR_IN + 0.12, _BAR_IN, height_in)
            figure.colorbar(drawn, cax=cax).set_label("error d (µm)")
        if title == "Before correction":
            axes.set_ylabel("height z on the target (mm)")
        else:
            axes.tick_params(labelleft=False)
    return figure


def add_panel(figure: Figure, left_in: float, width_in: float, height_in: float) -> Axes:
    """Axes at a place given in inches, so that panels of equal scale line up."""
    whole_width, whole_height = figure.get_size_inches()
    box = (left_in / whole_width, _BOTTOM_IN / whole_height, width_in / whole_width, height_in / whole_height)
    return figure.add_axes(box)


def mean_and_scatter_um(error_um: FloatArray) -> str:
    """Mean and standard deviation of what is known of ``(M,)``, for a panel."""
    known = error_um[np.isfinite(error_um)]
    return f"{known.mean():.1f} ± {known.std():.1f} µm" if known.size else "no dot inside the hull"


def panel_width_in(pos0: Validation, target: GridTarget, height_in: float) -> float:
    """Width of a panel of `paint_dots` of this height, at equal scales."""
    left, right, bottom, top = _extent_mm(pos0, target)
    return height_in * (right - left) / (top - bottom)


def paint_dots(
    axes: Axes, pos0: Validation, target: GridTarget, error_um: FloatArray, scale: Normalize
) -> PatchCollection:
    """A square for each dot of the unfolded target, coloured by ``error_um`` ``(M,)``; hatched where it is NaN."""
    along, height = _unfolded_mm(pos0, target)
    known = np.isfinite(error_um)
    half = target.pitch_mm / 2.0
    squares = [
        Rectangle((x - half, z - half), target.pitch_mm, target.pitch_mm) for x, z in zip(along, height, strict=True)
    ]
    drawn = PatchCollection(
        [square for square, here in zip(squares, known, strict=True) if here],
        cmap=ERROR_COLOURS,
        norm=scale,
        edgecolor="face",  # a seam shows between squares that only touch
        linewidth=0.6,
    )
    drawn.set_array(error_um[known])
    axes.add_collection(drawn)
    outside = [square for square, here in zip(squares, known, strict=True) if not here]
    axes.add_collection(PatchCollection(outside, facecolor="none", edgecolor=MISSING, hatch="////", linewidth=0.3))
    left, right, bottom, top = _extent_mm(pos0, target)
    if left < 0.0 < right:
        axes.axvline(0.0, color=INK, linewidth=1.0, linestyle=(0, (4, 2)))
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    return drawn


def _unfolded_mm(pos0: Validation, target: GridTarget) -> tuple[FloatArray, FloatArray]:
    """Place of every dot on the unfolded faces: along them from the edge (left face negative) and upwards."""
    face, row, column = target.face_row_column(pos0.index)
    along = target.margin_mm + column * target.pitch_mm
    return np.where(face == 0, along, -along), ((target.rows - 1) / 2.0 - row) * target.pitch_mm


def _extent_mm(pos0: Validation, target: GridTarget) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of the panel."""
    along, height = _unfolded_mm(pos0, target)
    rim = 0.7 * target.pitch_mm
    return along.min() - rim, along.max() + rim, height.min() - rim, height.max() + rim


def _top(error_um: FloatArray) -> float:
    """The colour scale's upper end: the largest error, or 1 where nothing is known."""
    known = error_um[np.isfinite(error_um)]
    return float(known.max()) if known.size else 1.0
