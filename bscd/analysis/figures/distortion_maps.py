"""The four distortion maps in sections over the calibrated volume (paper, figure 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, SubFigure

from bscd.analysis.figures.style import FAINT, INK, SHIFT_COLOURS, new_figure, styled
from bscd.arrays import FloatArray
from bscd.calibration import Calibration

_TITLES = (
    "$u_L$: left view, along columns; sections at depth y",
    "$v_L$: left view, along rows; sections at depth y",
    "$u_R$: right view, along columns; sections at depth y",
    "$v_R$: right view, along rows; sections at depth y",
)
_PLACES = ((0, 0), (1, 0), (0, 1), (1, 1))
_COUNT = 5
_CELL_MM = 0.5
_LEVELS = 13


@dataclass(frozen=True)
class Sections:
    """Sections across the depth: grid lines ``x_mm``, ``z_mm``, depths ``y_mm`` ``(S,)``.

    ``shifts_px`` ``(S, Z, X, 4)`` is NaN outside the hull.
    """

    x_mm: FloatArray
    y_mm: FloatArray
    z_mm: FloatArray
    shifts_px: FloatArray


@styled
def draw_distortion_maps(calibration: Calibration) -> Figure:
    """u_L, v_L, u_R, v_R in five sections across the depth, inside the hull only; px."""
    sections = cut_sections(calibration)
    figure = new_figure(5.5)
    grid = figure.add_gridspec(2, 2, wspace=0.0, hspace=0.0)
    for which, place in enumerate(_PLACES):
        _draw_block(figure.add_subfigure(grid[place]), sections, which)
    return figure


def cut_sections(calibration: Calibration, count: int = _COUNT) -> Sections:
    """The maps on evenly spaced sections of the calibrated volume, near to far."""
    points = calibration.control.distorted_mm
    low, high = points.min(axis=0), points.max(axis=0)
    depths = np.linspace(low[1] + 0.5, high[1] - 0.5, count)
    x = np.arange(low[0], high[0] + _CELL_MM, _CELL_MM)
    z = np.arange(low[2], high[2] + _CELL_MM, _CELL_MM)
    y_grid, z_grid, x_grid = np.meshgrid(depths, z, x, indexing="ij")
    at = np.stack([x_grid, y_grid, z_grid], axis=-1).reshape(-1, 3)
    inside = calibration.hull.contains(at)
    shifts = np.full((len(at), 4), np.nan)
    shifts[inside] = calibration.maps.shifts_px(at[inside])
    return Sections(x, depths, z, shifts.reshape(*x_grid.shape, 4))


def _draw_block(block: SubFigure, sections: Sections, which: int) -> None:
    """One map: its sections side by side on one pair of axes, and its colour scale (white is no shift)."""
    shifts = sections.shifts_px[..., which]
    limit = max(float(np.nanmax(np.abs(shifts), initial=0.0)), 1e-6)
    axes = block.add_axes((0.115, 0.15, 0.755, 0.69))
    step = (sections.x_mm[-1] - sections.x_mm[0]) * 1.12 + _CELL_MM
    for order, section in enumerate(shifts):
        x = sections.x_mm + order * step
        axes.pcolormesh(
            x, sections.z_mm, section, cmap=SHIFT_COLOURS, vmin=-limit, vmax=limit, shading="nearest", rasterized=True
        )
        if np.isfinite(section).sum() > 8:
            levels = np.linspace(-limit, limit, _LEVELS)
            axes.contour(x, sections.z_mm, section, levels, colors=INK, linewidths=0.4, alpha=0.55)
        name = f"{sections.y_mm[order]:+.1f} mm".replace("-", "\N{MINUS SIGN}")
        axes.text((x[0] + x[-1]) / 2, 1.03, name, transform=axes.get_xaxis_transform(), ha="center", fontsize=8.5)
        if order:
            axes.axvline(x[0] - 0.06 * step, color=FAINT, linewidth=0.6)
    _mark_x(axes, sections.x_mm, step, len(shifts))
    axes.set_ylabel("z (mm)")
    axes.set_xlabel("x (mm)")
    block.text(0.115, 0.955, _TITLES[which], fontsize=10, va="center")
    scale = ScalarMappable(Normalize(-limit, limit), SHIFT_COLOURS)
    bar = block.colorbar(scale, cax=block.add_axes((0.885, 0.15, 0.02, 0.69)))
    bar.ax.set_title("px", fontsize=8.5, fontweight="normal", loc="left")
    bar.ax.tick_params(length=2.5)


def _mark_x(axes: Axes, x_mm: FloatArray, step: float, count: int) -> None:
    """Ticks of x that start again in each section."""
    marks = [mark for mark in (-10.0, 0.0, 10.0) if x_mm[0] <= mark <= x_mm[-1]]
    names = [f"{mark:g}".replace("-", "\N{MINUS SIGN}") for mark in marks]
    axes.set_xlim(x_mm[0] - 0.06 * step, x_mm[-1] + (count - 1) * step + 0.06 * step)
    axes.set_xticks(
        [mark + order * step for order in range(count) for mark in marks],
        names * count,
    )
    axes.tick_params(length=2.5)
    axes.tick_params(axis="x", labelsize=7.5)
