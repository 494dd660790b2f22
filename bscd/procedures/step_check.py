"""The check of one scan position's frames, before they are stored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

from bscd.acquisition import CameraName, FrameRecord
from bscd.calibration.dots import SplitLine
from bscd.calibration.target import GridTarget
from bscd.procedures.checks import TargetImage, find_one_grid, find_two_grids, require_exposed, split_line
from bscd.procedures.recipes import ScanRecipe, ScanStep


class StepCheck:
    """Checks the frames of a scan's positions, one after the other.

    Every frame must be well exposed; in the first of each camera the dots must be found, in both halves or in
    the whole image as the scan needs. ``full_scale`` is each camera's largest grey level.
    """

    def __init__(self, recipe: ScanRecipe, target: GridTarget, full_scale: Mapping[CameraName, float]) -> None:
        self._recipe = recipe
        self._target = target
        self._full_scale = full_scale
        self._split: SplitLine | None = None

    def __call__(self, step: ScanStep, records: Sequence[FrameRecord]) -> None:
        """Raise `CheckFailedError` with the reason when a position's frames are not good."""
        roles = self._recipe.camera_roles
        with ThreadPoolExecutor(len(roles), thread_name_prefix="check") as pool:
            checks = [
                pool.submit(self._check, [self._seen(record, step) for record in records if record.camera == role])
                for role in roles
            ]
        for check in checks:
            check.result()

    def _check(self, images: Sequence[TargetImage]) -> None:
        """One camera's frames."""
        for image in images[1:]:
            require_exposed(image)
        if self._recipe.kind == "reference":
            find_one_grid(images[0], self._target)
        else:
            require_exposed(images[0])
            find_two_grids(images[0], self._target, self._split_of(images[0]))

    def _split_of(self, seen: TargetImage) -> SplitLine:
        """The split line of the scan's first image; the prism stays where it is."""
        if self._split is None:
            self._split = split_line(seen.image)
        return self._split

    def _seen(self, record: FrameRecord, step: ScanStep) -> TargetImage:
        where = f"{record.camera} camera, {step}"
        return TargetImage(record.data, self._full_scale[record.camera], step.pose, where)
