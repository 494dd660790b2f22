"""From a run file to the labelled dots of its images: what a calibration is made from."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from bscd.acquisition import FrameMean, PhaseName, RunFile
from bscd.calibration import GridTarget, View
from bscd.calibration import observations as vocabulary
from bscd.calibration.dots import GridFinding, MissingDot, SplitLine, find_split
from bscd.errors import CheckFailedError, InputError
from bscd.procedures.checks import TargetImage, find_one_grid, find_two_grids, middle_regions
from bscd.procedures.progress import Progress, ProgressCallback
from bscd.procedures.recipes import ScanKind
from bscd.procedures.scan_contents import CAMERAS_OF, PHASES_OF, POSES, require_phases, scan_groups, scan_places, where

THREADS = 2
_SPLIT_IMAGES = 12


@dataclass(frozen=True)
class MissingInView:
    """A dot that one view lacks, and why."""

    camera: vocabulary.CameraName
    pose: vocabulary.PoseName
    position: int
    dot: MissingDot


@dataclass(frozen=True)
class Observations:
    """All labelled dots of a scan, what is missing with reasons, and warnings in sentences.

    ``image_size_px`` is (width, height); ``split`` the line between the halves, None for a reference scan or
    where it was not found; ``jack_mm`` ``(K,)`` the jacks' readings, one a position (NaN where not recorded).
    """

    views: tuple[View, ...]
    image_size_px: tuple[int, int]
    split: SplitLine | None
    jack_mm: tuple[float, ...]
    missing: tuple[MissingInView, ...]
    warnings: tuple[str, ...]


def observe(
    run: RunFile,
    target: GridTarget,
    kind: ScanKind,
    *,
    phases: Sequence[PhaseName] | None = None,
    threads: int = THREADS,
    progress: ProgressCallback | None = None,
) -> Observations:
    """Average the repeated frames of every position of a scan and find the dots.

    Parameters
    ----------
    kind
        "reference": both cameras without the biprism; "bsc": the two halves of the primary camera's images.
    phases
        Those that must be there; by default the corner and the face of this kind.

    Raises
    ------
    InputError
        A phase or a camera is missing, or a position's place is not known.
    CheckFailedError
        Images that can not be used: saturated, dots missing, the biprism in the wrong place. The message says
        what is wrong with the first, and how many there are.
    """
    needed = PHASES_OF[kind] if phases is None else tuple(phases)
    warnings = require_phases(run, kind, needed)
    split = None
    if kind == "bsc":
        split, told = _find_split(run, needed)
        warnings += told
    wanted = [group for camera in CAMERAS_OF[kind] for group in scan_places(run, camera, needed)]
    found = list(_find_all(run, target, kind, needed, split, threads, progress, len(wanted)))
    views, missing, failures = [], [], []
    for group, outcome in found:
        if isinstance(outcome, CheckFailedError):
            failures.append(str(outcome))
            continue
        for name, finding in outcome:
            view = _view(group, name, finding, run)
            views.append(view)
            missing += [MissingInView(name, view.pose, view.position, dot) for dot in finding.missing]
            warnings += [f"{where(group)}, {name} view: {text}" for text in finding.warnings]
    if failures:
        more = f" ({len(failures)} of {len(found)} images can not be used)" if len(failures) > 1 else ""
        raise CheckFailedError(f"{run.path}: {failures[0]}{more}")
    size_px = run.cameras["primary"].width_px, run.cameras["primary"].height_px
    jack_mm = tuple(group.jack_mm for group, _ in found)
    return Observations(tuple(views), size_px, split, jack_mm, tuple(missing), tuple(warnings))


_Found = list[tuple[vocabulary.CameraName, GridFinding]]


def _find_all(
    run: RunFile,
    target: GridTarget,
    kind: ScanKind,
    phases: Sequence[PhaseName],
    split: SplitLine | None,
    threads: int,
    progress: ProgressCallback | None,
    total: int,
) -> Iterator[tuple[FrameMean, _Found | CheckFailedError]]:
    """The findings of every position in the order recorded; frames are read while others are searched."""
    find = _finder(run, target, kind, split)
    waiting: deque[tuple[FrameMean, Future[_Found | CheckFailedError]]] = deque()
    done = 0

    def finish() -> tuple[FrameMean, _Found | CheckFailedError]:
        nonlocal done
        group, future = waiting.popleft()
        outcome = future.result()
        done += 1
        if progress is not None:
            progress(Progress(done, total, where(group)))
        # the image is not needed any more, its readings are
        return _without_image(group), outcome

    with ThreadPoolExecutor(threads, thread_name_prefix="dots") as pool:
        for group in scan_groups(run, kind, phases):
            waiting.append((group, pool.submit(find, group)))
            if len(waiting) > 2 * threads:
                yield finish()
        while waiting:
            yield finish()


def _finder(
    run: RunFile, target: GridTarget, kind: ScanKind, split: SplitLine | None
) -> Callable[[FrameMean], _Found | CheckFailedError]:
    def find(group: FrameMean) -> _Found | CheckFailedError:
        full_scale = float(2 ** run.cameras[group.camera].bit_depth - 1)
        seen = TargetImage(group.data, full_scale, POSES[group.phase], where(group))
        try:
            if kind == "reference":
                return [(group.camera, find_one_grid(seen, target))]
            return list(find_two_grids(seen, target, split or middle_regions(seen.image)[0].split).items())
        except CheckFailedError as error:
            return error

    return find


def _find_split(run: RunFile, phases: Sequence[PhaseName]) -> tuple[SplitLine | None, list[str]]:
    """The split line from images all over the scan."""
    places = scan_places(run, "primary", phases)
    chosen = set(places[:: max(1, math.ceil(len(places) / _SPLIT_IMAGES))])
    dtype = run.cameras["primary"].dtype
    images = [
        np.rint(group.data).astype(dtype)
        for group in scan_groups(run, "bsc", phases)
        if (group.phase, group.target_position) in chosen
    ]
    try:
        split = find_split(images)
    except CheckFailedError as error:
        return None, [f"{run.path}: {error}; the image's middle column is taken for it"]
    return split, []


def _view(group: FrameMean, name: vocabulary.CameraName, finding: GridFinding, run: RunFile) -> View:
    if group.target_position is None or not math.isfinite(group.y_mm):
        lacking = "target_position" if group.target_position is None else "y_mm"
        raise InputError(f"{run.path}: {where(group)}: {lacking} is not known; give it in the manifest")
    return View(
        camera=name,
        pose=POSES[group.phase],
        position=group.target_position,
        y_mm=group.y_mm,
        rotation_deg=group.rotation_deg,
        index=finding.index,
        xy_px=finding.xy_px,
        sigma_px=finding.sigma_px,
    )


def _without_image(group: FrameMean) -> FrameMean:
    return FrameMean(
        camera=group.camera,
        phase=group.phase,
        target_position=group.target_position,
        data=group.data[:0].copy(),
        count=group.count,
        peak=group.peak,
        y_mm=group.y_mm,
        rotation_deg=group.rotation_deg,
        jack_mm=group.jack_mm,
        pressure_kpa=group.pressure_kpa,
    )
