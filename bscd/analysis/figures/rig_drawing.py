"""The drawing of a designed rig, to scale: camera, biprism, the two views and what both of them see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bscd.analysis.figures.style import AFTER, BEFORE, FAINT, FLOOR, INK, new_figure, panel_title, styled
from bscd.arrays import FloatArray

_VIEW_COLOURS = {"left": AFTER, "right": BEFORE}
_GLASS = "#9ecae1"


@dataclass(frozen=True)
class RigDrawing:
    """A rig seen from above; all points are (x, y) in mm, x to the right and y away from the camera.

    ``camera_mm`` ``(2,)`` is the camera's centre, ``prism_mm`` ``(P, 2)`` the prism's outline, ``rays_mm`` the
    rays of each view ("left", "right"), its border rays among them, as polylines ``(K, 2)`` from the camera to
    beyond the object. ``dimensions`` are (name, from y, to y) in mm; ``facts`` are shown as they are.
    """

    camera_mm: FloatArray
    prism_mm: FloatArray
    rays_mm: Mapping[str, Sequence[FloatArray]]
    dimensions: Sequence[tuple[str, float, float]] = ()
    facts: Sequence[str] = ()


_STEPS = 400
_WHOLE = (0.07, 0.69, 0.91, 0.24)
_NEAR = (0.07, 0.09, 0.91, 0.5)


@styled
def draw_rig(rig: RigDrawing) -> Figure:
    """Above the whole rig, below the space around prism and object enlarged; equal scales along both axes."""
    figure = new_figure(6.0)
    last = max(ray[-1, 1] for rays in rig.rays_mm.values() for ray in rays)
    nearest = rig.prism_mm[:, 1].min() - 15.0
    whole = _add_view(figure, _WHOLE, rig.camera_mm[1] - 25.0, last + 5.0)
    near = _add_view(figure, _NEAR, nearest, last + 3.0)
    for axes in (whole, near):
        _draw_parts(axes, rig)
    for name, begin, end in rig.dimensions:
        _dimension(whole, begin, end, name)
    near.set_xlabel("y (mm), away from the camera; the object is at 0")
    panel_title(whole, "The rig from above, to scale")
    panel_title(near, "Prism, both views and what both of them see")
    near.legend(loc="upper right", ncols=4, columnspacing=1.4, handlelength=1.6)
    if rig.facts:
        middle = (rig.prism_mm[:, 1].max() - nearest) / (last + 3.0 - nearest) + 0.02
        near.text(middle, 0.04, "\n".join(rig.facts), transform=near.transAxes, va="bottom", linespacing=1.5)
    return figure


def _add_view(figure: Figure, box: tuple[float, float, float, float], first: float, last: float) -> Axes:
    """Axes over y from ``first`` to ``last``, x about 0 at the same scale, to the right pointing down."""
    axes = figure.add_axes(box)
    width_in, height_in = figure.get_size_inches()
    half = (last - first) * (box[3] * height_in) / (box[2] * width_in) / 2.0
    axes.set_xlim(first, last)
    axes.set_ylim(half, -half)
    axes.set_ylabel("x (mm)")
    return axes


def _draw_parts(axes: Axes, rig: RigDrawing) -> None:
    overlap, prism = overlap_outline_mm(rig), rig.prism_mm
    axes.fill(overlap[:, 1], overlap[:, 0], color=FLOOR, alpha=0.35, linewidth=0, label="seen by both views")
    axes.fill(prism[:, 1], prism[:, 0], facecolor=_GLASS, edgecolor=INK, linewidth=0.9, alpha=0.75, label="biprism")
    for view, rays in rig.rays_mm.items():
        for order, ray in enumerate(rays):
            label = f"{view} view" if order == 0 else None
            axes.plot(ray[:, 1], ray[:, 0], color=_VIEW_COLOURS[view], linewidth=0.9, label=label)
    axes.plot(rig.camera_mm[1], rig.camera_mm[0], marker=">", color=INK, markersize=8, linestyle="none")
    axes.axvline(0.0, color=FAINT, linewidth=0.8, linestyle=(0, (4, 3)))


def overlap_outline_mm(rig: RigDrawing) -> FloatArray:
    """Outline ``(Q, 2)`` of what both views see between prism and the rays' ends; empty where that is nothing."""
    rays = [ray for view in rig.rays_mm.values() for ray in view]
    y = np.linspace(rig.prism_mm[:, 1].max(), min(ray[-1, 1] for ray in rays), _STEPS)
    spans = [
        np.array([np.interp(y, ray[:, 1], ray[:, 0]) for ray in view]) for view in rig.rays_mm.values()
    ]  # (rays, steps) each
    low = np.max([span.min(axis=0) for span in spans], axis=0)
    high = np.min([span.max(axis=0) for span in spans], axis=0)
    seen = high > low
    sides = [np.column_stack([x[seen], y[seen]]) for x in (low, high)]
    return np.concatenate([sides[0], sides[1][::-1]])


def _dimension(axes: Axes, begin: float, end: float, name: str) -> None:
    """A dimension line at the foot of the drawing."""
    foot, transform = 0.1, axes.get_xaxis_transform()
    axes.annotate(
        "",
        (begin, foot),
        (end, foot),
        xycoords=transform,
        arrowprops={"arrowstyle": "<->", "color": INK, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0},
    )
    text = f"{name} = {abs(end - begin):.4g} mm"
    axes.text((begin + end) / 2.0, foot + 0.04, text, transform=transform, ha="center")
