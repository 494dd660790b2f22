"""The drawing of a designed rig, to scale: camera, biprism, the two views and what both of them see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

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
    border and middle rays of each view ("left", "right") as polylines ``(K, 2)`` from the camera to beyond the
    object, ``overlap_mm`` ``(Q, 2)`` the outline of what both views see. ``facts`` are shown as they are.
    """

    camera_mm: FloatArray
    prism_mm: FloatArray
    rays_mm: Mapping[str, Sequence[FloatArray]]
    overlap_mm: FloatArray
    facts: Sequence[str] = field(default_factory=tuple)


@styled
def draw_rig(rig: RigDrawing) -> Figure:
    """Above the whole rig, below the space around prism and object enlarged; equal scales along both axes."""
    figure = new_figure(6.0)
    whole = figure.add_axes((0.07, 0.72, 0.91, 0.2))
    near = figure.add_axes((0.07, 0.09, 0.91, 0.52))
    for axes in (whole, near):
        _draw_parts(axes, rig)
        axes.set_aspect("equal", adjustable="datalim" if axes is whole else "box")
        axes.set_ylabel("x (mm)")
    first = rig.camera_mm[1]
    last = max(ray[-1, 1] for rays in rig.rays_mm.values() for ray in rays)
    whole.set_xlim(first - 25.0, last + 5.0)
    _dimension(whole, rig.camera_mm[1], rig.prism_mm[:, 1].max(), "d_c")
    _dimension(whole, rig.prism_mm[:, 1].max(), 0.0, "d_o")
    panel_title(whole, "The rig from above, to scale")
    near.set_xlim(rig.prism_mm[:, 1].min() - 15.0, last + 3.0)
    half = 1.15 * max(
        np.abs(rig.prism_mm[:, 0]).max(), *(np.abs(r[:, 0]).max() for v in rig.rays_mm.values() for r in v)
    )
    near.set_ylim(half, -half)
    whole.set_ylim(half * 1.2, -half * 1.2)
    near.set_xlabel("y (mm), away from the camera; the object is at 0")
    panel_title(near, "Prism, both views and their overlap")
    if rig.facts:
        near.text(0.015, 0.03, "\n".join(rig.facts), transform=near.transAxes, va="bottom", linespacing=1.5)
    return figure


def _draw_parts(axes: Axes, rig: RigDrawing) -> None:
    overlap, prism = rig.overlap_mm, rig.prism_mm
    axes.fill(overlap[:, 1], overlap[:, 0], color=FLOOR, alpha=0.35, linewidth=0, label="seen by both views")
    axes.fill(prism[:, 1], prism[:, 0], facecolor=_GLASS, edgecolor=INK, linewidth=0.9, alpha=0.75, label="biprism")
    for view, rays in rig.rays_mm.items():
        for order, ray in enumerate(rays):
            label = f"{view} view" if order == 0 else None
            axes.plot(ray[:, 1], ray[:, 0], color=_VIEW_COLOURS[view], linewidth=0.9, label=label)
    axes.plot(rig.camera_mm[1], rig.camera_mm[0], marker=">", color=INK, markersize=8, linestyle="none")
    axes.axvline(0.0, color=FAINT, linewidth=0.8, linestyle=(0, (4, 3)))


def _dimension(axes: Axes, begin: float, end: float, name: str) -> None:
    """A dimension line above the drawing."""
    top = -0.04
    axes.annotate(
        "",
        (begin, top),
        (end, top),
        xycoords=("data", "axes fraction"),
        arrowprops={"arrowstyle": "<->", "color": INK, "linewidth": 0.8},
    )
    middle = (begin + end) / 2.0
    axes.text(
        middle, top + 0.1, f"{name} = {abs(end - begin):.0f} mm", transform=axes.get_xaxis_transform(), ha="center"
    )
