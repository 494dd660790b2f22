"""What every view must be: in focus, bright enough, not saturated."""

from __future__ import annotations

from bscd.procedures.align_items import AlignmentItem, item
from bscd.procedures.checks import SATURATED_LIMIT
from bscd.procedures.dot_figures import GridFigures

EDGE_LIMIT_PX = 1.5
BRIGHTNESS_GOOD = 0.65
BRIGHTNESS_RANGE = 0.3


def view_items(name: str, figures: GridFigures) -> tuple[AlignmentItem, ...]:
    """Focus, brightness and saturation of one view."""
    return (
        item(
            f"{name}: blur of the dots' edges",
            figures.edge_sigma_px,
            "px",
            EDGE_LIMIT_PX,
            low="focus the lens on the target",
            high="focus the lens on the target, or close the aperture",
        ),
        item(
            f"{name}: brightness between the dots",
            figures.brightness,
            "of full scale",
            BRIGHTNESS_RANGE,
            ideal=BRIGHTNESS_GOOD,
            low=f"lengthen the exposure {BRIGHTNESS_GOOD / max(figures.brightness, 1e-3):.1f} times, or add light",
            high=f"shorten the exposure to {BRIGHTNESS_GOOD / max(figures.brightness, 1e-3):.0%}, or dim the light",
        ),
        item(
            f"{name}: saturated pixels around the dots",
            figures.saturated_share,
            "of all",
            SATURATED_LIMIT,
            low="",
            high="shorten the exposure or dim the light",
        ),
    )
