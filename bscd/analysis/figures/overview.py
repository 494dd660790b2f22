"""One picture of the whole: what the camera sees through the biprism, and what the correction does."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bscd.analysis.figures.error_map import add_panel, mean_and_scatter_um, paint_dots, panel_width_in
from bscd.analysis.figures.style import bare, new_figure, panel_title, styled
from bscd.analysis.validation import Validation
from bscd.calibration import GridTarget

_HEIGHT_IN = 3.6


@styled
def draw_overview(image: NDArray[np.uint8], pos0: Validation, target: GridTarget) -> Figure:
    """The biprism image ``(H, W)`` on the left, the error at POS.0 before and after on the right."""
    image_in = _HEIGHT_IN * image.shape[1] / image.shape[0]
    panel_in = panel_width_in(pos0, target, _HEIGHT_IN)
    figure = new_figure(_HEIGHT_IN + 1.08, image_in + 2 * panel_in + 2.15)
    seen = add_panel(figure, 0.12, image_in, _HEIGHT_IN)
    seen.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="antialiased", aspect="auto")
    bare(seen)
    panel_title(seen, "One camera, two views through the biprism")
    errors = {"Before correction": "uncorrected", "After correction": "corrected"}
    scale = Normalize(0.0, 1e3 * float(np.nanmax(pos0.error_mm("uncorrected"))))
    left_in = image_in + 0.85
    for title, which in errors.items():
        error_um = 1e3 * pos0.error_mm(which)
        axes = add_panel(figure, left_in, panel_in, _HEIGHT_IN)
        drawn = paint_dots(axes, pos0, target, error_um, scale)
        panel_title(axes, title)
        axes.set_xlabel("along the target (mm)\n" + mean_and_scatter_um(error_um))
        if which == "uncorrected":
            axes.set_ylabel("height z (mm)")
        else:
            axes.tick_params(labelleft=False)
            bar = figure.colorbar(drawn, cax=add_panel(figure, left_in + panel_in + 0.12, 0.14, _HEIGHT_IN))
            bar.set_label("error of each dot (µm)")
        left_in += panel_in + 0.25
    return figure
