"""The error in each third of the depth, before and after correction."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from bscd.analysis.figures.error_volume import logarithmic_um
from bscd.analysis.figures.style import AFTER, BEFORE, FLOOR, NOTHING_INSIDE, draw_nothing, new_figure, styled
from bscd.analysis.validation import Validation

THIRDS = ("near", "middle", "far")
_SPACING = 0.27
_LOW, _HIGH = 5.0, 95.0


@styled
def draw_depth_thirds(volume: Validation) -> Figure:
    """Mean (mark and number) and the range of 90 % of the dots (bar) in each third, micrometres."""
    if not volume.inside.any():
        return draw_nothing(NOTHING_INSIDE)
    figure = new_figure(3.2, 7.2)
    axes = figure.add_axes((0.1, 0.12, 0.66, 0.83))
    series = [("before", BEFORE, volume.error_mm("uncorrected"), "o")]
    series.append(("after", AFTER, volume.error_mm("corrected"), "s"))
    if volume.floor_mm is not None:
        series.append(("floor (twin)", FLOOR, volume.error_mm("floor", "truth"), "D"))
    for order, (name, colour, error_mm, mark) in enumerate(series):
        label: str | None = name
        for third in range(3):
            known = 1e3 * error_mm[volume.depth_third(third) & np.isfinite(error_mm)]
            if known.size == 0:
                continue
            place = third + (order - (len(series) - 1) / 2.0) * _SPACING
            axes.plot([place] * 2, np.percentile(known, [_LOW, _HIGH]), color=colour, linewidth=5, alpha=0.35)
            axes.plot(place, known.mean(), mark, color=colour, markersize=6, label=label)
            axes.annotate(
                f"{known.mean():.3g}",
                (place, np.percentile(known, _HIGH)),
                (0, 3),
                textcoords="offset points",
                ha="center",
                fontsize=8,
            )
            label = None
    axes.set_xticks(range(3), [f"{name} third" for name in THIRDS])
    axes.set_xlim(-0.5, 2.5)
    logarithmic_um(axes, "y")
    axes.grid(True, axis="y")
    axes.set_ylabel("error d (µm)")
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), title="mark: mean\nbar: 90 % of the dots")
    return figure
