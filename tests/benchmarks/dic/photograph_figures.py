"""Pictures of what bscd finds on MultiDIC's photographs, for docs/photographs.md."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bscd.analysis.figures.style import (
    AFTER,
    BEFORE,
    ERROR_COLOURS,
    FAINT,
    FLOOR,
    SHIFT_COLOURS,
    bare,
    new_figure,
    panel_title,
    styled,
)
from bscd.arrays import FloatArray
from tests.benchmarks.dic.photographs import LEFT, RADIUS_MM, RIGHT, Photographs, Positions, fit_cylinder

#: The point whose epipolar curve is drawn.
_ONE = 3000


@styled
def views_figure(photographs: Photographs, ours: Positions) -> Figure:
    """Both views with every point that was matched, coloured by its distance from MultiDIC's match."""
    figure = new_figure(5.6)
    apart = np.linalg.norm(ours[RIGHT, 1] - photographs.stored[RIGHT, 1], axis=1)
    panels = figure.subplots(1, 4, width_ratios=(1, 1, 1, 0.05))
    for panel, camera in zip(panels, (LEFT, RIGHT, RIGHT), strict=False):
        _photograph(panel, photographs, camera, ours[camera, 1])
    for panel, camera in zip(panels, (LEFT, RIGHT), strict=False):
        panel.plot(*ours[camera, 1][_ONE], "o", mec=BEFORE, mfc="none", ms=9, mew=2)
    panels[1].plot(*photographs.curve(photographs.points_px[_ONE : _ONE + 1])[0].T, color=BEFORE, lw=2)
    drawn = panels[2].scatter(*ours[RIGHT, 1].T, c=apart, s=2.2, lw=0, cmap=ERROR_COLOURS, vmin=0.0, vmax=0.06)
    for panel, title in zip(
        panels, ("left: a point", "right: its curve, its match", "right: all matches"), strict=False
    ):
        panel_title(panel, title)
    figure.colorbar(drawn, cax=panels[3], label="distance from MultiDIC's match, px", extend="max")
    figure.subplots_adjust(0.01, 0.02, 0.93, 0.94, 0.05)
    return figure


def _photograph(panel: Axes, photographs: Photographs, camera: int, at_px: FloatArray) -> None:
    grey = cv2.resize(photographs.grey(camera, 1), None, fx=0.2, fy=0.2, interpolation=cv2.INTER_AREA)
    column, row = np.nanmean(at_px, axis=0)
    height, width = photographs.region.shape
    panel.imshow(grey, cmap="gray", extent=(0.0, width, height, 0.0), interpolation="antialiased")
    panel.set_xlim(column - 500, column + 500)
    panel.set_ylim(row + 1330, row - 1330)
    bare(panel)


@styled
def cylinder_figure(
    photographs: Photographs, ours: Positions, bias_px: Mapping[int, float], multidic_px: float
) -> Figure:
    """The radial deviation over the unrolled cylinder, the calibration's marks beside it, and the affine bias."""
    figure = new_figure(4.6)
    panels = figure.subplots(1, 3, width_ratios=(1, 1, 1.25))
    marks = fit_cylinder(photographs.marks_mm())
    surface = fit_cylinder(photographs.surface(ours, 1))
    for panel, cylinder, title, size in zip(panels, (surface, marks), ("speckle", "marks"), (3, 22), strict=False):
        drawn = panel.scatter(
            cylinder.angle_deg,
            cylinder.along_mm,
            c=cylinder.off_mm,
            s=size,
            lw=0,
            cmap=SHIFT_COLOURS,
            vmin=-0.8,
            vmax=0.8,
        )
        panel.set_title(f"{title}: {cylinder.radius_mm:.2f} mm")
        panel.set_xlabel("angle about the axis, deg")
        panel.set_xlim(-42, 62)
        panel.set_ylim(-120, 120)
    panels[0].set_ylabel("along the axis, mm")
    figure.colorbar(drawn, ax=panels[1], label=f"radial deviation, mm (cylinder: {RADIUS_MM:g} mm)")
    area = np.array([subset**2 - 1 for subset in bias_px], float)
    panels[2].plot(area, list(bias_px.values()), "o", color=AFTER, label="bscd, first order")
    panels[2].plot(
        [0, area.max()], [0, np.polyfit(area, list(bias_px.values()), 1)[0] * area.max()], color=FAINT, lw=1, zorder=0
    )
    panels[2].plot(12 * 21**2 / 4, multidic_px, "s", color=BEFORE, label="MultiDIC, circle of radius 21 px")
    panels[2].axhline(0, color=FLOOR, lw=1)
    panels[2].set_xlabel("second moment of the subset x 12, px$^2$")
    panels[2].set_ylabel("mean column less second order's, px")
    panels[2].set_title("first order's bias")
    panels[2].legend(loc="lower right", bbox_to_anchor=(1.0, 0.08))
    figure.tight_layout()
    return figure
