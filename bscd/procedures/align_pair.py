"""The two cameras' alignment: same settings, same height, same scale, both pointed at the target."""

from __future__ import annotations

import numpy as np

from bscd.calibration.dots import GridFinding
from bscd.calibration.target import GridTarget
from bscd.procedures.align_items import AlignmentItem, item
from bscd.procedures.align_view import view_items
from bscd.procedures.checks import TargetImage, expected_dots, find_one_grid
from bscd.procedures.dot_figures import GridFigures, grid_figures
from drivers.interfaces import CameraStatus

EXPOSURE_LIMIT = 0.01
GAIN_LIMIT_DB = 0.1
HEIGHT_LIMIT_MM = 1.0
ROLL_LIMIT_DEG = 1.0
SCALE_LIMIT = 0.05
OVERLAP_LIMIT = 0.05
CENTRE_LIMIT = 0.1
"""Of the image's width."""


def pair_items(
    primary: TargetImage,
    auxiliary: TargetImage,
    target: GridTarget,
    primary_status: CameraStatus,
    auxiliary_status: CameraStatus,
) -> tuple[AlignmentItem, ...]:
    """The figures of two images of the target in the same place, taken without the biprism.

    Raises `CheckFailedError` when the dots can not be found in one of them.
    """
    findings = find_one_grid(primary, target), find_one_grid(auxiliary, target)
    first = grid_figures(primary.image, primary.full_scale, findings[0], target)
    second = grid_figures(auxiliary.image, auxiliary.full_scale, findings[1], target)
    return (
        *_settings_items(primary_status, auxiliary_status),
        *_height_items(findings, first, target),
        item(
            "roll, auxiliary against primary",
            roll := second.roll_deg - first.roll_deg,
            "deg",
            ROLL_LIMIT_DEG,
            # a picture that leans clockwise was taken by a camera that leans counter-clockwise
            low=f"turn the auxiliary camera {-roll:.1f} deg counter-clockwise about its viewing axis",
            high=f"turn the auxiliary camera {roll:.1f} deg clockwise about its viewing axis",
        ),
        item(
            "scale, auxiliary over primary",
            second.pitch_px / first.pitch_px,
            "",
            SCALE_LIMIT,
            ideal=1.0,
            low="move the auxiliary camera nearer, or set both lenses to the same focal length",
            high="move the auxiliary camera away, or set both lenses to the same focal length",
        ),
        _overlap_item(primary, findings, target),
        _centre_item("primary", primary, first),
        _centre_item("auxiliary", auxiliary, second),
        *view_items("primary", first),
        *view_items("auxiliary", second),
    )


def _settings_items(primary: CameraStatus, auxiliary: CameraStatus) -> tuple[AlignmentItem, ...]:
    exposure = f"set the auxiliary camera's exposure to {primary.exposure_s:g} s, as the primary's"
    gain = f"set the auxiliary camera's gain to {primary.gain_db:g} dB, as the primary's"
    return (
        item(
            "exposure, auxiliary over primary",
            auxiliary.exposure_s / primary.exposure_s,
            "",
            EXPOSURE_LIMIT,
            ideal=1.0,
            low=exposure,
            high=exposure,
        ),
        item(
            "gain, auxiliary minus primary",
            auxiliary.gain_db - primary.gain_db,
            "dB",
            GAIN_LIMIT_DB,
            low=gain,
            high=gain,
        ),
    )


def _height_items(
    findings: tuple[GridFinding, GridFinding], figures: GridFigures, target: GridTarget
) -> tuple[AlignmentItem, ...]:
    """Rows of the same dots, lower in the auxiliary image counted positive: then that camera looks too high."""
    _, first, second = np.intersect1d(findings[0].index, findings[1].index, return_indices=True)
    rows_px = findings[1].xy_px[second, 1] - findings[0].xy_px[first, 1]
    down_px = float(rows_px.mean()) if rows_px.size else float("nan")
    down_mm = down_px * target.pitch_mm / figures.pitch_px
    return (
        item(
            "target's height in the images, auxiliary below primary",
            down_mm,
            "mm",
            HEIGHT_LIMIT_MM,
            low=f"raise the auxiliary camera, or tilt it up, until its image has moved {abs(down_px):.0f} px down",
            high=f"lower the auxiliary camera, or tilt it down, until its image has moved {abs(down_px):.0f} px up",
            note=f"{down_px:+.1f} px",
        ),
    )


def _overlap_item(seen: TargetImage, findings: tuple[GridFinding, GridFinding], target: GridTarget) -> AlignmentItem:
    shared = np.intersect1d(findings[0].index, findings[1].index).size / expected_dots(target, seen.pose)
    return item(
        "dots that both cameras see",
        shared,
        "of all",
        OVERLAP_LIMIT,
        ideal=1.0,
        low="point both cameras at the target until both show all of its dots",
        high="",
    )


def _centre_item(name: str, seen: TargetImage, figures: GridFigures) -> AlignmentItem:
    width_px = seen.image.shape[1]
    off_px = figures.centre_px[0] - (width_px - 1) / 2.0
    return item(
        f"{name}: target from the image's middle",
        off_px,
        "px",
        CENTRE_LIMIT * width_px,
        low=f"turn the {name} camera to the left until its image has moved {-off_px:.0f} px to the right",
        high=f"turn the {name} camera to the right until its image has moved {off_px:.0f} px to the left",
    )
