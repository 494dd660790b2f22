"""Checks of a target image: exposed, all dots there, the biprism where the image needs it."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bscd.calibration.dots import GridFinding, SplitLine, SplitRegion, find_grid, find_split
from bscd.calibration.dots.findings import Image
from bscd.calibration.observations import PoseName
from bscd.calibration.target import GridTarget
from bscd.errors import CheckFailedError

Half = Literal["left", "right"]
HALVES: tuple[Half, Half] = ("left", "right")

FULL_SCALE = 0.996
"""Share of the largest grey level from which a pixel counts as saturated."""
SATURATED_LIMIT = 0.01
"""Share of saturated pixels, of the image or on and around the dots, above which an image is refused."""
DARK_LIMIT = 0.1
"""Share of the largest grey level that the brightest percent of an image has to reach."""
FOUND_LIMIT = 0.8
"""Share of the pose's dots that has to be found."""


@dataclass(frozen=True)
class TargetImage:
    """An image of the target and what is known of it.

    ``image`` ``(H, W)`` is uint8, uint16, or the float mean of such frames with ``full_scale`` their largest
    grey level; ``where`` names it in messages: "primary camera, face pose, POS.+3".
    """

    image: Image
    full_scale: float
    pose: PoseName
    where: str


def saturated_share(image: Image, full_scale: float) -> float:
    """Share of an image's pixels at full scale."""
    return float(np.mean(image >= FULL_SCALE * full_scale))


def require_exposed(seen: TargetImage) -> None:
    """Raise `CheckFailedError` for a saturated or a dark image."""
    saturated = saturated_share(seen.image, seen.full_scale)
    if saturated > SATURATED_LIMIT:
        raise CheckFailedError(
            f"{seen.where}: {saturated:.0%} of the image is saturated; shorten the exposure or dim the light"
        )
    bright = float(np.percentile(seen.image[::4, ::4], 99.0)) / seen.full_scale
    if bright < DARK_LIMIT:
        raise CheckFailedError(
            f"{seen.where}: the image is dark (its brightest part reaches {bright:.0%} of full scale); check the "
            f"lens cap and the light, or lengthen the exposure"
        )


def find_one_grid(seen: TargetImage, target: GridTarget) -> GridFinding:
    """The dots of an image taken without the biprism.

    Raises `CheckFailedError` when it is saturated or dark, dots are missing, or the biprism is in view.
    """
    require_exposed(seen)
    try:
        finding = find_grid(seen.image, target, seen.pose)
        _require_complete(finding, target, seen.pose, seen.where)
    except CheckFailedError as error:
        if any(_finds(seen, target, region) for region in middle_regions(seen.image)):
            raise CheckFailedError(
                f"{seen.where}: the grid is seen twice or cut, so the biprism is in the view; lower it "
                f"([prism] lowered_mm) and scan again"
            ) from error
        raise _placed(error, seen.where) from error
    return finding


def find_two_grids(
    seen: TargetImage, target: GridTarget, split: SplitLine, needed: float = FOUND_LIMIT
) -> Mapping[Half, GridFinding]:
    """The dots of both halves of an image taken through the biprism; ``needed`` is the share that has to be found.

    Raises `CheckFailedError` when it is saturated or dark, dots are missing, or the biprism is not in view.
    """
    require_exposed(seen)
    findings: dict[Half, GridFinding] = {}
    try:
        with ThreadPoolExecutor(len(HALVES), thread_name_prefix="halves") as pool:  # the kernels release the GIL
            found: dict[Half, Future[GridFinding]] = {
                half: pool.submit(find_grid, seen.image, target, seen.pose, region=SplitRegion(split, half))
                for half in HALVES
            }
        for half, future in found.items():
            where = f"{seen.where}, {half} view"
            try:
                findings[half] = future.result()
            except CheckFailedError as error:
                raise _placed(error, where) from error
            _require_complete(findings[half], target, seen.pose, where, needed)
    except CheckFailedError as error:
        if _finds(seen, target, None):
            raise CheckFailedError(
                f"{seen.where}: the grid is seen once, so the biprism is not in the view; raise it "
                f"([prism] raised_mm) and scan again"
            ) from error
        raise
    return findings


def split_line(image: Image) -> SplitLine:
    """The split line of one biprism image, the middle column where it can not be found."""
    try:
        return find_split([image])
    except CheckFailedError:
        return middle_regions(image)[0].split


def middle_regions(image: Image) -> tuple[SplitRegion, SplitRegion]:
    """The halves of an image along its middle column."""
    height_px, width_px = image.shape
    middle = SplitLine(
        column_px=(width_px - 1) / 2.0,
        tilt=0.0,
        found=False,
        sigma_px=width_px / 4.0,
        middle_row_px=(height_px - 1) / 2.0,
    )
    return SplitRegion(middle, "left"), SplitRegion(middle, "right")


def expected_dots(target: GridTarget, pose: PoseName) -> int:
    """Dots of the faces that a pose shows."""
    return target.dots_per_face * (2 if pose == "corner" else 1)


def _require_complete(
    finding: GridFinding, target: GridTarget, pose: PoseName, where: str, needed: float = FOUND_LIMIT
) -> None:
    expected = expected_dots(target, pose)
    if finding.saturated_fraction > SATURATED_LIMIT:
        raise CheckFailedError(
            f"{where}: {finding.saturated_fraction:.0%} of the pixels around the dots are saturated; shorten the "
            f"exposure or dim the light"
        )
    if len(finding.index) < needed * expected:
        reasons = sorted({dot.reason for dot in finding.missing}) or ["not seen"]
        raise CheckFailedError(
            f"{where}: {len(finding.index)} of {expected} dots were found ({', '.join(reasons[:2])}); uncover the "
            f"target, move it into the view, and check [target] columns and rows"
        )


def _finds(seen: TargetImage, target: GridTarget, region: SplitRegion | None) -> bool:
    """Whether a whole grid is found in a part of the image."""
    try:
        finding = find_grid(seen.image, target, seen.pose, region=region)
    except CheckFailedError:
        return False
    return len(finding.index) >= FOUND_LIMIT * expected_dots(target, seen.pose)


def _placed(error: CheckFailedError, where: str) -> CheckFailedError:
    return error if str(error).startswith(where) else CheckFailedError(f"{where}: {error}")
