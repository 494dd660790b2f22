"""The biprism view's alignment: where the split line is, its tilt, how symmetric the halves are."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from bscd.calibration.dots import GridFinding, SplitLine
from bscd.calibration.target import GridTarget
from bscd.errors import CheckFailedError
from bscd.procedures.align_items import AlignmentItem, item
from bscd.procedures.align_view import view_items
from bscd.procedures.checks import Half, TargetImage, find_two_grids, middle_regions
from bscd.procedures.dot_figures import GridFigures, grid_figures

SPLIT_OFFSET_LIMIT = 0.03
"""Of the image's width."""
ROLL_LIMIT_DEG = 0.5
LEAN_LIMIT_DEG = 0.06
CENTRE_LIMIT = 0.02
"""Of the image's width."""
DOTS_LIMIT = 0.02
"""Of the pose's dots."""
HEIGHT_LIMIT = 0.005
BRIGHTNESS_LIMIT = 0.15
NEEDED = 0.3
"""Share of the dots that has to be in each half for the rest to be measured."""


def biprism_items(seen: TargetImage, target: GridTarget, split: SplitLine | None) -> tuple[AlignmentItem, ...]:
    """The figures of an image through the biprism; ``split`` None where neither the line nor a gap was found.

    Directions are as the camera sees them. Raises `CheckFailedError` when the dots can not be found in both
    halves.
    """
    findings = find_two_grids(seen, target, split or middle_regions(seen.image)[0].split, NEEDED)
    figures: dict[Half, GridFigures] = {
        half: grid_figures(seen.image, seen.full_scale, finding, target) for half, finding in findings.items()
    }
    left, right = figures["left"], figures["right"]
    return (
        *_split_items(seen, split),
        item(
            "biprism roll",
            roll := _roll_deg(findings),
            "deg",
            ROLL_LIMIT_DEG,
            low=f"turn the biprism {-roll:.2f} deg clockwise about the viewing axis",
            high=f"turn the biprism {roll:.2f} deg counter-clockwise about the viewing axis",
            note="from the height of the same dots in the two halves",
        ),
        item(
            "column lean, right minus left",
            right.roll_deg - left.roll_deg,
            "deg",
            LEAN_LIMIT_DEG,
            low="tilt the top of the biprism towards the camera",
            high="tilt the top of the biprism away from the camera",
        ),
        *_symmetry_items(seen, target, left, right),
        *view_items("left view", left),
        *view_items("right view", right),
    )


def _split_items(seen: TargetImage, split: SplitLine | None) -> tuple[AlignmentItem, ...]:
    width_px = seen.image.shape[1]
    note = "" if split and split.found else "the line itself is not seen: the middle of the gap between the grids"
    offset_px = math.nan if split is None else split.column_px - (width_px - 1) / 2.0
    place = item(
        "split line from the image's middle",
        offset_px,
        "px",
        SPLIT_OFFSET_LIMIT * width_px,
        low=f"shift the biprism to the right until the line has moved {abs(offset_px):.0f} px",
        high=f"shift the biprism to the left until the line has moved {abs(offset_px):.0f} px",
        note=note,
    )
    if split is None or not split.found:
        return (place,)
    # rows count downwards: a line that runs to the right on its way down leans counter-clockwise
    tilt_deg = -math.degrees(math.atan(split.tilt))
    return (
        place,
        item(
            "split line tilt",
            tilt_deg,
            "deg",
            ROLL_LIMIT_DEG,
            low=f"turn the biprism {-tilt_deg:.2f} deg clockwise about the viewing axis",
            high=f"turn the biprism {tilt_deg:.2f} deg counter-clockwise about the viewing axis",
        ),
    )


def _symmetry_items(
    seen: TargetImage, target: GridTarget, left: GridFigures, right: GridFigures
) -> tuple[AlignmentItem, ...]:
    width_px = seen.image.shape[1]
    middle_px = (left.centre_px[0] + right.centre_px[0] - (width_px - 1)) / 2.0
    return (
        item(
            "middle of the two grids from the image's middle",
            middle_px,
            "px",
            CENTRE_LIMIT * width_px,
            low=f"shift the target, or turn the camera, until the grids have moved {-middle_px:.0f} px to the right",
            high=f"shift the target, or turn the camera, until the grids have moved {middle_px:.0f} px to the left",
        ),
        item(
            "dots, right minus left",
            right.dots - left.dots,
            "dots",
            DOTS_LIMIT * max(left.dots, right.dots),
            low="shift the target to the right until both halves show all dots",
            high="shift the target to the left until both halves show all dots",
        ),
        item(
            "height of the grid, right over left",
            right.height_px / left.height_px,
            "",
            HEIGHT_LIMIT,
            ideal=1.0,
            low="turn the biprism about the vertical until its back face is parallel to the sensor",
            high="turn the biprism about the vertical until its back face is parallel to the sensor",
        ),
        item(
            "brightness, right over left",
            right.brightness / left.brightness,
            "",
            BRIGHTNESS_LIMIT,
            ideal=1.0,
            low="move light to what the right half shows",
            high="move light to what the left half shows",
        ),
    )


def _roll_deg(findings: Mapping[Half, GridFinding]) -> float:
    """Angle of the lines from dots of the left view to the same dots of the right one, positive clockwise.

    The roof deviates the two views apart at right angles to its edge, so this is the edge's angle to the columns.
    """
    left, right = findings["left"], findings["right"]
    both, at_left, at_right = np.intersect1d(left.index, right.index, return_indices=True)
    if both.size == 0:
        raise CheckFailedError("alignment: the two halves show no dot in common; centre the target")
    across, down = (right.xy_px[at_right] - left.xy_px[at_left]).mean(axis=0)
    return math.degrees(math.atan2(down, across))
