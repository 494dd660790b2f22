"""What a run file holds of a scan: its phases, cameras and positions; what is lacking."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from bscd.acquisition import CameraName, FrameMean, PhaseName, RunFile, RunState
from bscd.calibration.observations import PoseName
from bscd.errors import InputError
from bscd.procedures.recipes import ScanKind

POSES: dict[str, PoseName] = {
    "reference-corner": "corner",
    "reference-face": "face",
    "bsc-corner": "corner",
    "bsc-face": "face",
}
PHASES_OF: dict[ScanKind, tuple[PhaseName, PhaseName]] = {
    "reference": ("reference-corner", "reference-face"),
    "bsc": ("bsc-corner", "bsc-face"),
}
CAMERAS_OF: dict[ScanKind, tuple[CameraName, ...]] = {"reference": ("primary", "auxiliary"), "bsc": ("primary",)}


def scan_groups(run: RunFile, kind: ScanKind, phases: Sequence[PhaseName]) -> Iterator[FrameMean]:
    """The mean image of every position of a scan, camera by camera and phase by phase."""
    for camera in CAMERAS_OF[kind]:
        for phase in phases:
            yield from run.groups(camera, phase)


def scan_places(run: RunFile, camera: CameraName, phases: Sequence[PhaseName]) -> list[tuple[str, int | None]]:
    """Phase and k of every position that a camera saw."""
    places: dict[tuple[str, int | None], None] = {}
    for phase in phases:
        for row in run.table(camera, phase):
            if row["status"] == "ok":
                k = float(row["target_position"])
                places[phase, None if math.isnan(k) else int(k)] = None
    return list(places)


def require_phases(run: RunFile, kind: ScanKind, phases: Sequence[PhaseName]) -> list[str]:
    """Raise `InputError` when a camera or phase is missing; return warnings of what else is not whole."""
    seen_by: dict[str, set[tuple[str, int | None]]] = {}
    for camera in CAMERAS_OF[kind]:
        if camera not in run.cameras:
            raise InputError(
                f"{run.path}: it has no {camera} camera, a {kind} scan needs {' and '.join(CAMERAS_OF[kind])}"
            )
        seen_by[camera] = set(scan_places(run, camera, phases))
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
            f"{run.path}: {phase}, POS.{k:+d} was seen by the {camera} camera only; image it with both"
            for phase, k in sorted(places - common, key=str)
            if k is not None
        ]
    if run.state is RunState.INTERRUPTED:
        warnings.append(f"{run.path}: the recording was interrupted ({run.reason}); what is there is used")
    return warnings


def where(group: FrameMean) -> str:
    """Camera, phase and position, for messages."""
    place = "" if group.target_position is None else f", POS.{group.target_position:+d}"
    return f"{group.camera} camera, {group.phase}{place}"
