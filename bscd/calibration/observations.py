"""What the cameras saw of the calibration target: labelled dots with their image positions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from bscd.arrays import FloatArray, IntArray

CameraName = Literal["primary", "auxiliary", "left", "right"]
PoseName = Literal["corner", "face"]


@dataclass(frozen=True)
class View:
    """The labelled dots that one camera, or one half of the biprism image, saw of the target in one pose.

    ``camera`` is "primary" or "auxiliary" without the biprism, "left" or "right" for the two halves through it.
    ``position`` is k of POS.k, ``y_mm`` the stage's displacement from POS.0 as read back, ``rotation_deg`` the
    rotation stage's reading. ``index`` ``(N,)`` are the labels of the target (`GridTarget.index`), ``xy_px``
    ``(N, 2)`` the images of the dots' centres (column, row), ``sigma_px`` ``(N,)`` their standard uncertainty per
    axis.
    """

    camera: CameraName
    pose: PoseName
    position: int
    y_mm: float
    rotation_deg: float
    index: IntArray
    xy_px: FloatArray
    sigma_px: FloatArray


NOMINAL_ROTATION_DEG: dict[PoseName, float] = {"corner": 45.0, "face": 0.0}
"""Rotation readings of the poses by definition (DESIGN section 2)."""


def with_nominal_rotation(views: Sequence[View]) -> list[View]:
    """The views, the pose's nominal rotation in place of a reading that is not known (NaN), as in an import."""
    return [
        replace(view, rotation_deg=NOMINAL_ROTATION_DEG[view.pose]) if math.isnan(view.rotation_deg) else view
        for view in views
    ]
