"""Whether the stated uncertainty is right: error over sigma against the normal distribution."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from bscd.analysis.figures.style import AFTER, INK, NOTHING_INSIDE, draw_nothing, new_figure, panel_title, styled
from bscd.analysis.validation import Validation
from bscd.arrays import FloatArray

COVERED_BY_ONE_SIGMA = 0.6827
_RANGE = 4.5


def error_over_sigma(volume: Validation) -> FloatArray:
    """Error of the corrected points over their stated one-sigma, ``(K, 3)``, inside the hull.

    Against the true positions where they are known, else against the expected ones.
    """
    true = volume.expected_mm if volume.truth_mm is None else volume.truth_mm
    return ((volume.corrected_mm - true) / volume.sigma_mm)[volume.inside]


@styled
def draw_sigma_histogram(volume: Validation) -> Figure:
    """One panel an axis; the line is the normal distribution that correct uncertainties give."""
    if not volume.inside.any():
        return draw_nothing(NOTHING_INSIDE)
    figure = new_figure(2.7)
    panels = figure.subplots(1, 3, sharey=True)
    figure.subplots_adjust(left=0.075, right=0.985, bottom=0.18, top=0.88, wspace=0.1)
    ratio = error_over_sigma(volume)
    bins = np.linspace(-_RANGE, _RANGE, 37)
    fine = np.linspace(-_RANGE, _RANGE, 181)
    for axes, name, values in zip(panels, "xyz", ratio.T, strict=True):
        inside = np.clip(values, -_RANGE, _RANGE)
        axes.hist(inside, bins, density=True, color=AFTER, alpha=0.6)
        axes.plot(fine, np.exp(-(fine**2) / 2.0) / np.sqrt(2.0 * np.pi), color=INK, linewidth=1.4)
        for edge in (-1.0, 1.0):
            axes.axvline(edge, color=INK, linewidth=0.8, linestyle=(0, (4, 3)))
        share = np.mean(np.abs(values) < 1.0) if values.size else 0.0
        panel_title(axes, f"{name}: {100 * share:.0f} % within ±1 sigma")
        axes.set_xlabel("error / stated sigma")
    panels[0].set_ylabel("share of dots per sigma")
    return figure
