"""Residuals of each camera as arrows over its image, before and after the lens and the prism are modelled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from bscd.analysis.figures.style import AFTER, BEFORE, FAINT, new_figure, panel_title, styled
from bscd.arrays import FloatArray

_CELL_PX = 48.0
_LEGEND_PX = 110.0
_SPARSE = 0.4


@dataclass(frozen=True)
class ResidualField:
    """Residuals of one image: at pixels ``xy_px`` ``(N, 2)``, measured minus modelled ``residual_px`` ``(N, 2)``.

    ``model`` says what was modelled; ``ideal`` is True where it is the pinhole alone.
    """

    xy_px: FloatArray
    residual_px: FloatArray
    model: str
    ideal: bool

    @property
    def rms_px(self) -> float:
        """Root mean square per axis."""
        return float(np.sqrt(np.mean(self.residual_px**2)))


@styled
def draw_residuals(fields: Mapping[str, tuple[ResidualField, ResidualField]], size_px: tuple[int, int]) -> Figure:
    """One column an image: above the pinhole alone, below the full model; arrows are means over squares of 48 px."""
    figure = new_figure(6.2 if len(fields) > 1 else 3.4)
    shape = (2, len(fields)) if len(fields) > 1 else (1, 2)
    panels = figure.subplots(*shape, sharex=True, sharey=True, squeeze=False)
    figure.subplots_adjust(
        left=0.07, right=0.985, bottom=0.09 if len(fields) > 1 else 0.16, top=0.93, wspace=0.06, hspace=0.2
    )
    for column, (name, pair) in enumerate(fields.items()):
        for row, field in enumerate(pair):
            axes = panels[row, column] if len(fields) > 1 else panels[0, row]
            _draw_field(axes, field, size_px)
            panel_title(axes, f"{name}: {field.model}")
    if len(fields) > 1:
        for axes in panels[0]:
            axes.tick_params(bottom=False)
    for axes in panels[-1]:
        axes.set_xlabel("column (px)")
    for axes in panels[:, 0]:
        axes.set_ylabel("row (px)")
    return figure


def _draw_field(axes: Axes, field: ResidualField, size_px: tuple[int, int]) -> None:
    at, mean = _cell_means(field)
    colour = BEFORE if field.ideal else AFTER
    longest = float(np.quantile(np.hypot(mean[:, 0], mean[:, 1]), 0.95))
    reference = _round_length(longest)
    axes.quiver(
        at[:, 0],
        at[:, 1],
        mean[:, 0],
        mean[:, 1],
        color=colour,
        angles="xy",
        scale_units="xy",
        scale=reference / (1.4 * _CELL_PX),
        width=0.0035,
        headwidth=4.0,
    )
    width, height = size_px
    axes.add_patch(Rectangle((-0.5, -0.5), width, height, facecolor="none", edgecolor=FAINT, linewidth=0.8))
    axes.set_xlim(-8, width + 8)
    axes.set_ylim(height + _LEGEND_PX, -8)
    axes.set_aspect("equal")
    axes.set_yticks(range(0, height, 400))
    axes.spines[["left", "bottom"]].set_visible(False)
    below = height + 0.6 * _LEGEND_PX
    axes.plot([0, 1.4 * _CELL_PX], [below] * 2, color=colour, linewidth=2.5)
    axes.text(1.9 * _CELL_PX, below, f"{reference:g} px", va="center", fontsize=8.5)
    axes.text(width, below, f"rms {field.rms_px:.2g} px per axis", va="center", ha="right", fontsize=8.5)


def _cell_means(field: ResidualField) -> tuple[FloatArray, FloatArray]:
    """Mean place and mean residual, ``(C, 2)`` each, over square cells of the image."""
    _, cell = np.unique(np.floor(field.xy_px / _CELL_PX).astype(np.int64), axis=0, return_inverse=True)
    count = np.bincount(cell)[:, None]
    kept = count[:, 0] >= _SPARSE * np.median(count)  # a mean of few dots is their noise
    place, mean = (
        np.stack([np.bincount(cell, values[:, axis]) for axis in (0, 1)], axis=1) / count
        for values in (field.xy_px, field.residual_px)
    )
    return place[kept], mean[kept]


def _round_length(length: float) -> float:
    """A length of 1, 2 or 5 times a power of ten, not above ``length``."""
    decade = 10.0 ** np.floor(np.log10(max(length, 1e-12)))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= max(length, 1e-12) * (1 + 1e-9)))
