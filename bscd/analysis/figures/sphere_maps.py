"""The sphere's radial deviation before and after the correction (paper, figure 7), and beside the standard pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from bscd.analysis.figures.style import (
    AFTER,
    FLOOR,
    SHIFT_COLOURS,
    draw_nothing,
    new_figure,
    panel_title,
    styled,
)
from bscd.analysis.figures.surface_map import limits_of, mark_apart, paint_map
from bscd.arrays import BoolArray, FloatArray

_NO_SPHERE = "No sphere could be fitted to the measured points."


@dataclass(frozen=True, eq=False)
class Deviations:
    """Radial deviations of one measurement of a sphere.

    ``places_mm`` ``(N, 2)`` as the camera sees them (x, z), ``deviation_mm`` ``(N,)`` NaN where not valid, ``mean_mm``
    and ``std_mm`` their figures, ``extrapolated`` ``(N,)``, ``sigma_mm`` ``(N,)`` the stated uncertainty along the
    radius, NaN where there is none.
    """

    name: str
    places_mm: FloatArray
    deviation_mm: FloatArray
    mean_mm: float
    std_mm: float
    extrapolated: BoolArray
    sigma_mm: FloatArray


@styled
def draw_sphere_maps(before: Deviations | None, after: Deviations | None) -> Figure:
    """Before; after on the same scale; after on its own. In micrometres."""
    shown = [one for one in (before, after) if one is not None]
    if not shown:
        return draw_nothing(_NO_SPHERE)
    figure = new_figure(4.0)
    common = limits_of(1e3 * shown[0].deviation_mm, symmetric=True)
    panels = [(one, common, "Before correction" if one is before else "After") for one in shown]
    if after is not None and before is not None:
        panels[-1] = (after, common, "After, same scale")
        panels.append((after, limits_of(1e3 * after.deviation_mm, symmetric=True), "After, own scale"))
    _draw_row(figure, panels)
    return figure


@styled
def draw_sphere_beside(after: Deviations, standard: Deviations) -> Figure:
    """Biprism and standard pair on one scale, and how their deviations are spread."""
    figure = new_figure(4.0)
    both = np.concatenate([after.deviation_mm, standard.deviation_mm])
    scale = limits_of(1e3 * both, symmetric=True)
    _draw_row(figure, [(after, scale, "Biprism"), (standard, scale, "Standard pair")])
    axes = figure.add_axes((0.73, 0.2, 0.255, 0.62))
    edges = np.linspace(1.4 * (scale.vmin or -1.0), 1.4 * (scale.vmax or 1.0), 61)
    for one, colour, name in ((after, AFTER, "biprism"), (standard, FLOOR, "standard pair")):
        known = 1e3 * one.deviation_mm[np.isfinite(one.deviation_mm)]
        axes.hist(
            np.clip(known, edges[0], edges[-1]), edges.tolist(), density=True, color=colour, alpha=0.55, label=name
        )
        sigma = one.sigma_mm[np.isfinite(one.deviation_mm) & np.isfinite(one.sigma_mm)]
        if sigma.size:
            wide = 1e3 * float(np.sqrt(np.mean(sigma**2)))
            fine = np.linspace(edges[0], edges[-1], 201)
            axes.plot(fine, np.exp(-0.5 * (fine / wide) ** 2) / (wide * np.sqrt(2.0 * np.pi)), color=colour)
    axes.set_xlabel("radial deviation (µm)")
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    panel_title(axes, "Spread; line: stated sigma")
    axes.legend(loc="upper left", bbox_to_anchor=(-0.02, 1.0), handlelength=1.2)
    return figure


def _draw_row(figure: Figure, panels: Sequence[tuple[Deviations, Normalize, str]]) -> None:
    """Panels of equal size from the left, a third of the width each, every one with its colour scale."""
    for place, (one, scale, title) in enumerate(panels):
        left = 0.06 + 0.325 * place
        axes = figure.add_axes((left, 0.2, 0.205, 0.66))
        paint_map(axes, one.places_mm, 1e3 * one.deviation_mm, SHIFT_COLOURS, scale)
        mark_apart(axes, one.places_mm, one.extrapolated)
        panel_title(axes, title)
        _label(axes, one, first=place == 0)
        cax = figure.add_axes((left + 0.218, 0.2, 0.012, 0.66))
        figure.colorbar(ScalarMappable(scale, SHIFT_COLOURS), cax=cax, extend="both").set_label("µm")


def _label(axes: Axes, one: Deviations, *, first: bool) -> None:
    mean, std = (
        f"{round(1e3 * value, 1) + 0.0:.1f}".replace("-", "\N{MINUS SIGN}") for value in (one.mean_mm, one.std_mm)
    )
    axes.set_xlabel(f"x (mm)\n{mean} ± {std} µm")
    if first:
        axes.set_ylabel("z (mm)")
    else:
        axes.tick_params(labelleft=False)
