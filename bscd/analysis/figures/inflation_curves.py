"""An inflation as curves: rise and strain against the pressure, and what was measured of each frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bscd.analysis.figures.style import AFTER, BEFORE, FAINT, FLOOR, INK, new_figure, panel_title, styled
from bscd.arrays import FloatArray

#: The paper's rise of the middle, mm, and its pressure, kPa (section 2.3).
PAPER_RISE = (13.0, 6.0)


@dataclass(frozen=True, eq=False)
class InflationCurves:
    """A value a frame ``(T,)``; ``pressure_kpa`` all NaN where it was not recorded, then time is shown."""

    time_s: FloatArray
    pressure_kpa: FloatArray
    w_apex_mm: FloatArray
    w_max_mm: FloatArray
    e1_middle: FloatArray
    e1_max: FloatArray
    valid_share: FloatArray


@styled
def draw_inflation_curves(curves: InflationCurves) -> Figure:
    """W and the first principal strain against pressure; pressure and valid points against time."""
    figure = new_figure(3.5)
    boxes = ((0.065, 0.16, 0.26, 0.68), (0.405, 0.16, 0.25, 0.68), (0.735, 0.16, 0.205, 0.68))
    rise, strain, course = (figure.add_axes(box) for box in boxes)
    pressed = bool(np.isfinite(curves.pressure_kpa).any())
    against = curves.pressure_kpa if pressed else curves.time_s
    name = "pressure (kPa)" if pressed else "time (s)"
    _two(rise, against, (curves.w_apex_mm, "middle"), (curves.w_max_mm, "largest"))
    if pressed:
        rise.plot(*PAPER_RISE, marker="*", markersize=11, color=FLOOR, linestyle="none", label="paper: about 6 mm")
    rise.set_ylabel("w (mm)")
    panel_title(rise, "Rise")
    rise.legend(loc="upper left")
    _two(strain, against, (100.0 * curves.e1_middle, "middle"), (100.0 * curves.e1_max, "largest"))
    strain.set_ylabel("first principal strain e1 (%)")
    panel_title(strain, "Strain (Green-Lagrange)")
    if np.isfinite(curves.e1_max).any():
        strain.legend(loc="upper left")
    for axes in (rise, strain):
        axes.set_xlabel(name)
        axes.grid(True)
    _draw_course(course, curves, pressed)
    return figure


def _two(axes: Axes, against: FloatArray, first: tuple[FloatArray, str], second: tuple[FloatArray, str]) -> None:
    order = np.argsort(against, kind="stable")
    for (values, label), colour, mark in ((second, BEFORE, "."), (first, AFTER, ".")):
        axes.plot(against[order], values[order], mark, color=colour, markersize=4.5, label=label)


def _draw_course(axes: Axes, curves: InflationCurves, pressed: bool) -> None:
    time_s = curves.time_s if np.isfinite(curves.time_s).any() else np.arange(len(curves.time_s), dtype=float)
    if pressed:
        axes.plot(time_s, curves.pressure_kpa, color=INK, linewidth=1.3)
        axes.set_ylabel("pressure (kPa), line")
    else:
        axes.set_yticks([])
    axes.set_xlabel("time (s)" if np.isfinite(curves.time_s).any() else "frame")
    panel_title(axes, "Course")
    share = axes.twinx()
    share.plot(time_s, 100.0 * curves.valid_share, ".", color=FAINT, markersize=4)
    share.set_ylim(0.0, 102.0)
    share.set_ylabel("valid points (%), dots")
    share.spines["right"].set_visible(True)
