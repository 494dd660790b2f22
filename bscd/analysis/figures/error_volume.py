"""The error over the volume: against the depth, as a histogram, and where the worst dots are."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from bscd.analysis.figures.style import (
    AFTER,
    BEFORE,
    ERROR_COLOURS,
    FLOOR,
    NOTHING_INSIDE,
    draw_nothing,
    new_figure,
    styled,
)
from bscd.analysis.validation import Validation
from bscd.arrays import FloatArray, IntArray

WORST_DOTS = 10
_DEPTH_BINS = 9
_CELL_MM = 2.0


@styled
def draw_error_volume(volume: Validation) -> Figure:
    """Errors of every dot inside the hull before and after; the circles mark the worst dots."""
    if not volume.inside.any():
        return draw_nothing(NOTHING_INSIDE)
    figure = new_figure(3.9)
    boxes = ((0.075, 0.14, 0.33, 0.7), (0.465, 0.14, 0.2, 0.7), (0.72, 0.14, 0.2, 0.7))
    depth_axes, count_axes, front_axes = (figure.add_axes(box) for box in boxes)
    series = [("before", BEFORE, volume.error_mm("uncorrected")), ("after", AFTER, volume.error_mm("corrected"))]
    if volume.floor_mm is not None:
        series.append(("floor (twin)", FLOOR, volume.error_mm("floor", "truth")))
    _draw_depth(depth_axes, volume.expected_mm[:, 1], series)
    _draw_counts(count_axes, series[:2])
    _draw_front(front_axes, volume)
    return figure


def worst_dots(volume: Validation, count: int = WORST_DOTS) -> IntArray:
    """Places in ``volume`` of the dots with the largest error after correction, largest first."""
    error = np.nan_to_num(volume.error_mm("corrected"), nan=-1.0)
    order = np.argsort(-error)[:count].astype(np.int64)
    return order[error[order] >= 0.0]


def logarithmic_um(axis: Axes, which: str) -> None:
    """A logarithmic axis in micrometres with plain numbers."""
    (axis.set_yscale if which == "y" else axis.set_xscale)("log")
    ruler = axis.yaxis if which == "y" else axis.xaxis
    ruler.set_major_locator(LogLocator(10.0, (1.0,)))
    ruler.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ruler.set_minor_formatter(NullFormatter())


def _draw_depth(axes: Axes, depth_mm: FloatArray, series: list[tuple[str, str, FloatArray]]) -> None:
    edges = np.linspace(depth_mm.min(), depth_mm.max(), _DEPTH_BINS + 1)
    middle = (edges[1:] + edges[:-1]) / 2.0
    place = np.clip(np.digitize(depth_mm, edges) - 1, 0, _DEPTH_BINS - 1)
    for name, colour, error_mm in series:
        known = np.isfinite(error_mm)
        if name != "floor (twin)":
            axes.plot(
                depth_mm[known], 1e3 * error_mm[known], ".", color=colour, alpha=0.18, markersize=3.0, rasterized=True
            )
        filled = [bin_ for bin_ in range(_DEPTH_BINS) if (known & (place == bin_)).any()]
        means = [1e3 * error_mm[known & (place == bin_)].mean() for bin_ in filled]
        dashes = "--" if name == "floor (twin)" else "-"
        axes.plot(middle[filled], means, dashes, color=colour, marker="o", markersize=4, label=name)
    logarithmic_um(axes, "y")
    axes.grid(True)
    axes.set_xlabel("depth y (mm), away from the camera")
    axes.set_ylabel("error d (µm)")
    axes.set_title("Against the depth (line: mean)", loc="left", pad=20.0)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 0.985), ncols=3, handlelength=1.8, columnspacing=1.2)


def _draw_counts(axes: Axes, series: list[tuple[str, str, FloatArray]]) -> None:
    known = [1e3 * error_mm[np.isfinite(error_mm)] for _, _, error_mm in series]
    together = np.concatenate(known)
    low, high = np.quantile(together[together > 0], [0.002, 1.0])
    bins = np.geomspace(low, high, 36)
    for (name, colour, _), values in zip(series, known, strict=True):
        axes.hist(values, bins, color=colour, alpha=0.75, label=name, histtype="stepfilled", edgecolor=colour)
    logarithmic_um(axes, "x")
    axes.set_xlabel("error d (µm)")
    axes.set_ylabel("dots")
    axes.set_title("How many dots", loc="left", pad=20.0)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 0.985), ncols=2, handlelength=1.2, columnspacing=1.2)


def _draw_front(axes: Axes, volume: Validation) -> None:
    """The mean over the depth of the error after correction, in squares, as the camera sees the volume."""
    error = 1e3 * volume.error_mm("corrected")
    known = np.isfinite(error)
    x, z = volume.expected_mm[:, 0], volume.expected_mm[:, 2]
    edges = [np.arange(v[known].min() - _CELL_MM / 2, v[known].max() + _CELL_MM, _CELL_MM) for v in (x, z)]
    total = np.histogram2d(x[known], z[known], edges, weights=error[known])[0]
    count = np.histogram2d(x[known], z[known], edges)[0]
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    drawn = axes.pcolormesh(edges[0], edges[1], mean.T, cmap=ERROR_COLOURS, vmin=0.0, rasterized=True)
    worst = worst_dots(volume)
    axes.scatter(x[worst], z[worst], s=52, facecolors="none", edgecolors=BEFORE, linewidths=1.3)
    axes.set_xlabel("x (mm)")
    axes.set_ylabel("z (mm)")
    axes.set_aspect("equal")
    axes.set_title("As the camera sees it", loc="left", pad=20.0)
    axes.figure.colorbar(drawn, ax=axes, fraction=0.07, pad=0.05).set_label("error d after, mean over y (µm)")
