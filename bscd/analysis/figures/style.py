"""How every figure looks: one palette, one type size, figures without pyplot's global state."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

INK = "#101418"
"""Text and axes. In the page's inline SVG this colour becomes the text's own, so that dark pages stay readable."""
FAINT = "#8a9099"
BEFORE = "#d55e00"
AFTER = "#0072b2"
FLOOR = "#009e73"
ACCENT = "#cc79a7"
"""The palette of Okabe and Ito (2008), which readers with any colour vision can tell apart."""
ERROR_COLOURS = "viridis"
SHIFT_COLOURS = "RdBu_r"
MISSING = "#9aa0a8"

NOTHING_INSIDE = "No dot of the second acquisition lies inside the calibrated hull."

WIDTH_IN = 9.6
"""Width of a figure; the page shows it at about this size, where its type is 9 to 10 points."""

_SETTINGS: dict[RcKeyType, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.grid": False,
    "grid.color": FAINT,
    "grid.alpha": 0.35,
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "hatch.linewidth": 0.6,
    "hatch.color": FAINT,
    "lines.linewidth": 1.6,
    "image.interpolation": "nearest",
    "svg.fonttype": "none",
    "svg.hashsalt": "bscd",
    "axes.unicode_minus": True,
}

_Parameters = ParamSpec("_Parameters")


@contextmanager
def house_style() -> Iterator[None]:
    """The settings above, for drawing and for saving."""
    with mpl.rc_context(_SETTINGS):
        yield


def styled(draw: Callable[_Parameters, Figure]) -> Callable[_Parameters, Figure]:
    """Draw a figure in the house style."""

    @wraps(draw)
    def drawn(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> Figure:
        with house_style():
            return draw(*args, **kwargs)

    return drawn


def new_figure(height_in: float, width_in: float = WIDTH_IN) -> Figure:
    """An empty figure on the Agg canvas."""
    figure = Figure(figsize=(width_in, height_in))
    FigureCanvasAgg(figure)
    return figure


def draw_nothing(reason: str) -> Figure:
    """A figure that says why there is nothing to show."""
    with house_style():
        figure = new_figure(1.2)
        figure.text(0.02, 0.5, reason, color=BEFORE, va="center", fontsize=11)
    return figure


def panel_title(axes: Axes, text: str) -> None:
    """A panel's title, at its left edge."""
    axes.set_title(text, loc="left")


def bare(axes: Axes) -> None:
    """No frame and no ticks."""
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
