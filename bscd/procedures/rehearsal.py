"""What a scan would take, computed before anything moves: limits over all positions, duration, disk."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from bscd.errors import InputError
from bscd.procedures.recipes import ScanRecipe, ScanStep
from bscd.procedures.rig import AxisRole, Rig
from drivers.interfaces import Axis, Camera, Range

READOUT_RATE_PX_S = 1.0e8
"""How fast frames come off a camera, for the estimate: a GigE link's 8-bit pixels, rounded down."""


@dataclass(frozen=True)
class DryRun:
    """What a scan would do. ``problems`` are sentences, one for each thing that keeps it from starting.

    ``duration_s`` counts moves, settling and exposures (NaN where a problem keeps it from being known),
    ``disk_bytes`` the raw frames before compression.
    """

    steps: tuple[ScanStep, ...]
    frames: int
    duration_s: float
    disk_bytes: int
    problems: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether the scan can start."""
        return not self.problems

    def require_ok(self) -> None:
        """Raise `InputError` with all problems in one line."""
        if self.problems:
            raise InputError(f"scan refused, nothing moved: {'; '.join(self.problems)}")


def dry_run(
    rig: Rig, recipe: ScanRecipe, *, start: int = 0, free_bytes: int | None = None, homed: bool = False
) -> DryRun:
    """Check a scan against the rig's limits and estimate it; moves nothing, takes no frame.

    Parameters
    ----------
    start
        The step to begin with, as when a scan goes on.
    free_bytes
        Space on the disk that it is to be written to, when known.
    homed
        The axes will be homed before.
    """
    steps = recipe.steps()
    if not 0 <= start < len(steps):
        raise InputError(f"scan: can not begin with step {start}, it has the steps 0 to {len(steps) - 1}")
    left = steps[start:]
    cameras = {role: rig.cameras[role] for role in recipe.camera_roles if role in rig.cameras}
    problems = [f"the {role} camera is missing" for role in recipe.camera_roles if role not in cameras]
    targets = axis_targets(rig, recipe, left)
    for role, positions in targets.items():
        problems += axis_problems(role, rig.axes[role], positions, homed=homed)
    for role, camera in cameras.items():
        problems += camera_problems(role, camera, recipe.exposure_s, recipe.gain_db)
    frame_bytes = sum(bytes_per_frame(camera) for camera in cameras.values())
    disk_bytes = len(left) * recipe.frames_per_position * frame_bytes
    if free_bytes is not None and disk_bytes > free_bytes:
        problems.append(f"it needs {disk_bytes / 1e6:.0f} MB, the disk has {free_bytes / 1e6:.0f} MB free")
    duration_s = float("nan")
    if not problems:
        moves_s = sum(_travel_s(rig.axes[role], positions) for role, positions in targets.items())
        exposures_s = sum(_frame_s(camera, recipe.exposure_s) for camera in cameras.values())
        duration_s = moves_s + len(left) * (recipe.settle_s + recipe.frames_per_position * exposures_s)
    frames = len(left) * len(recipe.camera_roles) * recipe.frames_per_position
    return DryRun(left, frames, duration_s, disk_bytes, tuple(problems))


def axis_targets(rig: Rig, recipe: ScanRecipe, steps: Iterable[ScanStep]) -> Mapping[AxisRole, list[float]]:
    """Every reading that each axis ("jacks", "translation", "rotation") is sent to, in order, in its unit."""
    steps = list(steps)
    return {
        "jacks": [prism_height_mm(rig, recipe)],
        "translation": [rig.origin_mm + step.y_mm for step in steps],
        "rotation": [step.rotation_deg for step in steps],
    }


def prism_height_mm(rig: Rig, recipe: ScanRecipe) -> float:
    """Where a scan needs the jacks: raised for "bsc", lowered for "reference"."""
    return rig.raised_mm if recipe.kind == "bsc" else rig.lowered_mm


def axis_problems(role: str, axis: Axis, positions: list[float], *, homed: bool = False) -> list[str]:
    """Sentences on what keeps an axis from going to all of these readings; ``homed``: it will be homed before."""
    info, status = axis.info(), axis.status()
    problems = []
    if status.fault:
        problems.append(f"{role}: {status.fault}; free the axis and home it")
    if not (homed or status.homed):
        problems.append(f"{role}: not homed; home it first")
    outside = [position for position in positions if not info.limits.contains(position)]
    if outside:
        low, high = min(outside), max(outside)
        needed = f"{low:g}" if low == high else f"{low:g} to {high:g}"
        allowed = f"{info.limits.low:g} to {info.limits.high:g} {info.unit}"
        problems.append(f"{role}: {needed} {info.unit} is needed, its limits are {allowed}")
    return problems


def camera_problems(role: str, camera: Camera, exposure_s: float | None, gain_db: float | None) -> list[str]:
    """Sentences on what keeps a camera from taking frames so (None: as it is set)."""
    info = camera.info()
    wanted: tuple[tuple[str, float | None, Range, str], ...] = (
        ("exposure_s", exposure_s, info.exposure_limits_s, "s"),
        ("gain_db", gain_db, info.gain_limits_db, "dB"),
    )
    problems = [
        f"{role} camera: {name} = {value:g} is outside {limits.low:g} to {limits.high:g} {unit}"
        for name, value, limits, unit in wanted
        if value is not None and not limits.contains(value)
    ]
    if camera.status().streaming:
        problems.append(f"{role} camera: it is streaming; stop the stream first")
    return problems


def bytes_per_frame(camera: Camera) -> int:
    """Size of a camera's raw frame."""
    info = camera.info()
    return info.width_px * info.height_px * (1 if info.bit_depth <= 8 else 2)


def _frame_s(camera: Camera, exposure_s: float | None) -> float:
    info = camera.info()
    exposed_s = camera.status().exposure_s if exposure_s is None else exposure_s
    return exposed_s + info.width_px * info.height_px / READOUT_RATE_PX_S


def _travel_s(axis: Axis, positions: list[float]) -> float:
    """Seconds that an axis moves to be at all these positions in turn."""
    here = axis.status().position
    total_s, at = 0.0, here
    for position in positions:
        total_s += axis.move_duration_s(position) if at == here else _duration_s(axis, here, abs(position - at))
        at = position
    return total_s


def _duration_s(axis: Axis, here: float, distance: float) -> float:
    """Seconds of a move over ``distance``, of which the axis only tells those that begin where it is.

    A distance longer than its room on either side adds the rest at top speed.
    """
    info = axis.info()
    up = info.limits.high - here
    down = here - info.limits.low
    room = max(up, down)
    reach = min(distance, room)
    target = min(here + reach, info.limits.high) if up >= down else max(here - reach, info.limits.low)
    return axis.move_duration_s(target) + (distance - reach) / info.speed
