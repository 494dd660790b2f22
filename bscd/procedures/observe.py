"""From a run file to the labelled dots of its images: what a calibration is made from."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from bscd.acquisition import CameraName, FrameMean, PhaseName, RunFile, RunState
from bscd.calibration import GridTarget, View
from bscd.calibration import observations as vocabulary
from bscd.calibration.dots import GridFinding, MissingDot, SplitLine
from bscd.calibration.dots.split import find_split
from bscd.errors import CheckFailedError, InputError
from bscd.procedures.checks import TargetImage, find_one_grid, find_two_grids, middle_regions
from bscd.procedures.progress import Progress, ProgressCallback
from bscd.procedures.recipes import ScanKind

THREADS = 2
_SPLIT_IMAGES = 12
_POSES: dict[str, vocabulary.PoseName] = {
    "reference-corner": "corner",
    "reference-face": "face",
    "bsc-corner": "corner",
    "bsc-face": "face",
}
_PHASES: dict[ScanKind, tuple[PhaseName, PhaseName]] = {
    "reference": ("reference-corner", "reference-face"),
    "bsc": ("bsc-corner", "bsc-face"),
}
_CAMERAS: dict[ScanKind, tuple[CameraName, ...]] = {"reference": ("primary", "auxiliary"), "bsc": ("primary",)}


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
    needed = _PHASES[kind] if phases is None else tuple(phases)
    warnings = _require_phases(run, kind, needed)
    split = None
    if kind == "bsc":
        split, told = _find_split(run, needed)
        warnings += told
    wanted = [group for camera in _CAMERAS[kind] for group in _places(run, camera, needed)]
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
            warnings += [f"{_where(group)}, {name} view: {text}" for text in finding.warnings]
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
            progress(Progress(done, total, _where(group)))
        # the image is not needed any more, its readings are
        return _without_image(group), outcome

    with ThreadPoolExecutor(threads, thread_name_prefix="dots") as pool:
        for group in _groups(run, kind, phases):
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
        seen = TargetImage(group.data, full_scale, _POSES[group.phase], _where(group))
        try:
            if kind == "reference":
                return [(group.camera, find_one_grid(seen, target))]
            return list(find_two_grids(seen, target, split or middle_regions(seen.image)[0].split).items())
        except CheckFailedError as error:
            return error

    return find


def _find_split(run: RunFile, phases: Sequence[PhaseName]) -> tuple[SplitLine | None, list[str]]:
    """The split line from images all over the scan."""
    places = _places(run, "primary", phases)
    chosen = set(places[:: max(1, math.ceil(len(places) / _SPLIT_IMAGES))])
    dtype = run.cameras["primary"].dtype
    images = [
        np.rint(group.data).astype(dtype)
        for group in _groups(run, "bsc", phases)
        if (group.phase, group.target_position) in chosen
    ]
    try:
        split = find_split(images)
    except CheckFailedError as error:
        return None, [f"{run.path}: {error}; the image's middle column is taken for it"]
    return split, []


def _groups(run: RunFile, kind: ScanKind, phases: Sequence[PhaseName]) -> Iterator[FrameMean]:
    for camera in _CAMERAS[kind]:
        for phase in phases:
            yield from run.groups(camera, phase)


def _places(run: RunFile, camera: CameraName, phases: Sequence[PhaseName]) -> list[tuple[str, int | None]]:
    """Phase and k of every position that a camera saw."""
    places: dict[tuple[str, int | None], None] = {}
    for phase in phases:
        for row in run.table(camera, phase):
            if row["status"] == "ok":
                k = float(row["target_position"])
                places[phase, None if math.isnan(k) else int(k)] = None
    return list(places)


def _require_phases(run: RunFile, kind: ScanKind, phases: Sequence[PhaseName]) -> list[str]:
    """Raise when a camera or phase is missing; warn of positions that not every camera saw."""
    seen_by: dict[str, set[tuple[str, int | None]]] = {}
    for camera in _CAMERAS[kind]:
        if camera not in run.cameras:
            raise InputError(
                f"{run.path}: it has no {camera} camera, a {kind} scan needs {' and '.join(_CAMERAS[kind])}"
            )
        seen_by[camera] = set(_places(run, camera, phases))
        for phase in phases:
            if not any(place[0] == phase for place in seen_by[camera]):
                there = sorted({str(name) for name in run.table()["phase"]})
                raise InputError(
                    f"{run.path}: it has no {phase} frames of the {camera} camera (it has "
                    f"{', '.join(there) or 'none'}); record or import them"
                )
    warnings = []
    common = set.intersection(*seen_by.values())
    for camera, places in seen_by.items():
        warnings += [
            f"{run.path}: {phase}, POS.{k:+d} was seen by the {camera} camera only and is left out"
            for phase, k in sorted(places - common, key=str)
            if k is not None
        ]
    if run.state is RunState.INTERRUPTED:
        warnings.append(f"{run.path}: the recording was interrupted ({run.reason}); what is there is used")
    return warnings


def _view(group: FrameMean, name: vocabulary.CameraName, finding: GridFinding, run: RunFile) -> View:
    if group.target_position is None or not math.isfinite(group.y_mm):
        lacking = "target_position" if group.target_position is None else "y_mm"
        raise InputError(f"{run.path}: {_where(group)}: {lacking} is not known; give it in the manifest")
    return View(
        camera=name,
        pose=_POSES[group.phase],
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


def _where(group: FrameMean) -> str:
    place = "" if group.target_position is None else f", POS.{group.target_position:+d}"
    return f"{group.camera} camera, {group.phase}{place}"
