"""Align the rig: measure what the operator can turn, in the biprism view and in the two cameras' views."""

from __future__ import annotations

import numpy as np

from bscd.calibration.dots import find_split
from bscd.calibration.observations import PoseName
from bscd.calibration.target import GridTarget
from bscd.errors import CheckFailedError, InputError
from bscd.procedures.align_items import AlignmentReport
from bscd.procedures.align_pair import pair_items
from bscd.procedures.align_prism import biprism_items
from bscd.procedures.checks import TargetImage
from bscd.procedures.rig import Rig
from drivers.interfaces import Camera

DEFAULT_FRAMES = 4


def align_biprism(
    rig: Rig, target: GridTarget, *, pose: PoseName = "corner", frames: int = DEFAULT_FRAMES
) -> AlignmentReport:
    """Raise the biprism, look through it and say what to turn; the target stays where it is.

    ``pose`` is the one in which the operator put the target. Raises `CheckFailedError` when the dots can not be
    found in both halves.
    """
    _move_prism(rig, rig.raised_mm)
    seen = picture(rig.primary, pose, "primary camera, alignment of the biprism", frames)
    try:
        split = find_split([seen.image])
    except CheckFailedError:
        split = None
    return AlignmentReport(biprism_items(seen, target, split))


def align_cameras(
    rig: Rig, target: GridTarget, *, pose: PoseName = "corner", frames: int = DEFAULT_FRAMES
) -> AlignmentReport:
    """Lower the biprism, compare the two cameras' views of the target and say what to turn.

    Raises `CheckFailedError` when the dots can not be found, `InputError` without an auxiliary camera.
    """
    if rig.auxiliary is None:
        raise InputError("alignment: the rig has no auxiliary camera; configure [devices.auxiliary]")
    _move_prism(rig, rig.lowered_mm)
    primary = picture(rig.primary, pose, "primary camera, alignment of the cameras", frames)
    auxiliary = picture(rig.auxiliary, pose, "auxiliary camera, alignment of the cameras", frames)
    return AlignmentReport(pair_items(primary, auxiliary, target, rig.primary.status(), rig.auxiliary.status()))


def _move_prism(rig: Rig, height_mm: float) -> None:
    try:
        if abs(rig.jacks.status().position - height_mm) > rig.jacks.info().resolution:
            rig.jacks.move_to(height_mm)
    finally:
        rig.jacks.stop()


def picture(camera: Camera, pose: PoseName, where: str, frames: int) -> TargetImage:
    """The mean of a few frames of a camera, as an image of the target in ``pose``."""
    full_scale = float(2 ** camera.info().bit_depth - 1)
    images = [np.asarray(camera.snap().data, np.float32) for _ in range(frames)]
    return TargetImage(np.mean(images, axis=0), full_scale, pose, where)
