"""What a recording needs of the rig, looked at before anything moves."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from bscd.errors import InputError
from bscd.procedures.recording.recipes import InflationRecipe, SphereRecipe
from bscd.procedures.recording.storing import Storing
from bscd.procedures.rehearsal import axis_problems, bytes_per_frame, camera_problems
from bscd.procedures.rig import CameraRole, Rig

#: What a run file takes beside its images at most, and with each frame.
_FILE_BYTES = 1_000_000
_ROW_BYTES = 1_000


def require_sphere(rig: Rig, recipe: SphereRecipe, path: Path) -> None:
    """Raise `InputError` with all that keeps a sphere from being recorded."""
    _refuse("sphere", sphere_problems(rig, recipe, path))


def sphere_problems(rig: Rig, recipe: SphereRecipe, path: Path, *, homed: bool = False) -> list[str]:
    """What keeps a sphere from being recorded, a sentence each; ``homed``: the axes will be homed before."""
    heights = [rig.raised_mm, rig.lowered_mm] if recipe.standard_pair else [rig.raised_mm]
    roles: list[CameraRole] = ["primary", "auxiliary"] if recipe.standard_pair else ["primary"]
    problems = axis_problems("jacks", rig.jacks, heights, homed=homed) + _cameras(rig, roles, recipe)
    if not problems:
        problems += _disk(rig, roles, 2 * recipe.frames, path)
    return problems


def require_inflation(rig: Rig, recipe: InflationRecipe, path: Path, storing: Storing) -> None:
    """Raise `InputError` with all that keeps an inflation from being recorded and stored so."""
    kept_bytes = storing.reserve_bytes + storing.beside_bytes
    _refuse("inflation", inflation_problems(rig, recipe, path, kept_bytes=kept_bytes))


def inflation_problems(
    rig: Rig, recipe: InflationRecipe, path: Path, *, homed: bool = False, kept_bytes: int = 0
) -> list[str]:
    """What keeps an inflation from being recorded, a sentence each; ``homed``: the axes will be homed before.

    ``kept_bytes`` of the disk are not for its frames.
    """
    problems = axis_problems("jacks", rig.jacks, [rig.raised_mm], homed=homed) + _cameras(rig, ["primary"], recipe)
    exposure_s = recipe.exposure_s or rig.primary.status().exposure_s
    if exposure_s * recipe.frame_rate_hz > 1.0:
        problems.append(
            f"an exposure of {exposure_s:g} s does not fit {recipe.frame_rate_hz:g} frames a second; lower one of them"
        )
    problems += _pressure(rig, recipe)
    if not problems:
        problems += _disk(rig, ["primary"], recipe.frame_count, path, kept_bytes)
    return problems


def _pressure(rig: Rig, recipe: InflationRecipe) -> list[str]:
    if rig.pressure is None:
        return ["the rig has no pressure source; configure [devices.pressure]"]
    info = rig.pressure.info()
    if not info.can_set:
        return ["the pressure source is a transducer alone; an inflation needs one that can set a pressure"]
    low, high = info.limits_kpa.low, info.limits_kpa.high
    return [
        f"{name} = {value:g} kPa is outside the pressure source's {low:g} to {high:g} kPa"
        for name, value in (("rest_kpa", recipe.rest_kpa), ("top_kpa", recipe.top_kpa))
        if not info.limits_kpa.contains(value)
    ]


def _cameras(rig: Rig, roles: Sequence[CameraRole], recipe: SphereRecipe | InflationRecipe) -> list[str]:
    problems = [f"the {role} camera is missing" for role in roles if role not in rig.cameras]
    for role in roles:
        if role in rig.cameras:
            problems += camera_problems(role, rig.cameras[role], recipe.exposure_s, recipe.gain_db)
    return problems


def _disk(rig: Rig, roles: Sequence[CameraRole], frames: int, path: Path, kept_bytes: int = 0) -> list[str]:
    needed = _FILE_BYTES + frames * (_ROW_BYTES + sum(bytes_per_frame(rig.cameras[role]) for role in roles))
    folder = path.absolute().parent
    try:
        free = shutil.disk_usage(folder).free
    except OSError as err:
        return [f"its folder {folder} can not be reached ({err.strerror}); make it, or choose another"]
    if needed + kept_bytes <= free:
        return []
    kept = f" beside {kept_bytes / 1e6:.0f} MB that are kept free or written meanwhile" if kept_bytes else ""
    return [
        f"it needs {needed / 1e6:.0f} MB{kept}, the disk has {free / 1e6:.0f} MB free; "
        "remove old runs, or choose another disk"
    ]


def _refuse(what: str, problems: list[str]) -> None:
    if problems:
        raise InputError(f"{what} refused, nothing moved: {'; '.join(problems)}")
