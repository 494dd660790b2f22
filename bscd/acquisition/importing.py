"""Make a run file of a folder of images and its manifest."""

from __future__ import annotations

import math
import tomllib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bscd.acquisition.images import read_grey
from bscd.acquisition.manifest import MANIFEST, ManifestRow, parse_manifest
from bscd.acquisition.names import AxisName, CameraName, PhaseName
from bscd.acquisition.problems import ImportRefusedError, Problem
from bscd.acquisition.records import AxisMeta, CameraMeta, FrameRecord, PressureMeta
from bscd.acquisition.survey import SeenImage, cameras_of, look_at, remarks
from bscd.acquisition.writer import RunWriter
from bscd.errors import InputError

RIG = "rig.toml"
_NS_PER_S = 1_000_000_000
_CORNERS = ("reference-corner", "bsc-corner")
_CALIBRATION = (*_CORNERS, "reference-face", "bsc-face")

#: POS.k is k steps from POS.0.
POSITION_STEP_MM = 2.0

ImportProgress = Callable[[int, int, str], None]
"""Called with how much is done, of how much, and what is being done."""

ConfigCheck = Callable[[str, str], object]
"""Called with the configuration's text and its name; raises `InputError`, a line a problem."""


@dataclass(frozen=True, slots=True)
class ImportResult:
    """A finished import: its run file, the frames of each camera and phase, and what is worth knowing."""

    path: Path
    uuid: str
    frames: Mapping[tuple[CameraName, PhaseName], int]
    warnings: tuple[str, ...]


def import_folder(
    folder: str | Path,
    out: str | Path,
    *,
    progress: ImportProgress | None = None,
    check_config: ConfigCheck | None = None,
) -> ImportResult:
    """Make the run file ``out`` of the images that ``folder/manifest.csv`` names.

    ``folder/rig.toml``, if there, becomes the run's configuration; its content is for ``check_config``. Frames
    stand in the manifest's order. A corner image without a target position was taken at POS.0; a calibration
    image without ``y_mm`` at ``POSITION_STEP_MM`` times its position.

    Raises
    ------
    ImportRefusedError
        Any row or image is bad; it holds all problems, and nothing was written.
    InputError
        There is no manifest, or ``out`` exists or can not be made.
    """
    folder, out = Path(folder), Path(out)
    report = progress or (lambda done, total, what: None)
    manifest = _read_text(folder, MANIFEST)
    _check_out(out)
    images = _images_in(folder)
    rows, problems = parse_manifest(manifest, images)
    config_text, rig_problems = _rig_text(folder, check_config)
    problems += rig_problems
    total = 2 * len(rows)
    seen: dict[str, SeenImage] = {}
    for number, row in enumerate(rows):
        if row.file and row.file not in seen:
            report(number, total, f"checking {row.file}")
            found = look_at(row, images[row.file], folder)
            if isinstance(found, Problem):
                problems.append(found)
            else:
                seen[row.file] = found
    cameras, size_problems = cameras_of(rows, seen)
    problems += size_problems
    if problems:
        raise ImportRefusedError(sorted(problems, key=_line))
    warnings = remarks(rows, images, seen)
    if not config_text:
        warnings.append(f"there is no {RIG} beside {MANIFEST}; calibrating needs the target's geometry from one")
    for name, camera in cameras.items():
        if 8 < camera.bit_depth < 16:
            warnings.append(
                f"the {name} camera's 16-bit images use {camera.bit_depth} bits; full scale is taken as that"
            )
    if any(_lacks_y(row) for row in rows):
        warnings.append(f"where y_mm is empty it is taken as {POSITION_STEP_MM:g} mm x target_position")
    run_uuid = _write(out, folder, rows, images, cameras, config_text, warnings, report)
    report(total, total, "done")
    return ImportResult(out, run_uuid, Counter((row.camera, row.phase) for row in rows), tuple(warnings))


def _read_text(folder: Path, name: str) -> str:
    path = folder / name
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; name the one that holds {MANIFEST} and the images")
    try:
        return path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError as err:
        raise InputError(f"{folder} holds no {name}; write one with a row an image") from err
    except (OSError, UnicodeDecodeError) as err:
        raise InputError(f"{path} can not be read as UTF-8 text ({err}); save it as such") from err


def _check_out(out: Path) -> None:
    """Say early what making the file would say after all images were read."""
    if out.exists():
        raise InputError(f"{out} exists already and raw data is never overwritten; choose another name")
    if not out.absolute().parent.is_dir():
        raise InputError(f"{out}: there is no folder {out.parent}; make it or choose another one")


def _images_in(folder: Path) -> dict[str, Path]:
    """The files below the folder by their relative path, without hidden ones."""
    found = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
    return {name: path for name, path in found.items() if not path.name.startswith(".")}


def _rig_text(folder: Path, check: ConfigCheck | None) -> tuple[str, list[Problem]]:
    if not (folder / RIG).exists():
        return "", []
    try:
        text = _read_text(folder, RIG)
        tomllib.loads(text)
        if check is not None:
            check(text, RIG)
    except tomllib.TOMLDecodeError as err:
        return "", [Problem(RIG, f"is not valid TOML: {err}")]
    except InputError as err:
        return "", [Problem(RIG, line.removeprefix(f"{RIG}: ")) for line in str(err).splitlines()]
    return text, []


def _write(
    out: Path,
    folder: Path,
    rows: list[ManifestRow],
    images: Mapping[str, Path],
    cameras: Mapping[CameraName, CameraMeta],
    config_text: str,
    warnings: list[str],
    report: ImportProgress,
) -> str:
    axes: dict[AxisName, AxisMeta] = {"translation": AxisMeta("mm"), "rotation": AxisMeta("deg")}
    has_pressure = any(not math.isnan(row.pressure_kpa) for row in rows)
    counts = Counter()
    writer = RunWriter(
        out,
        title=f"Import of {folder.resolve().name}",
        cameras=cameras,
        config_text=config_text,
        axes=axes,
        pressure=PressureMeta() if has_pressure else None,
        flush_every=64,
    )
    try:
        with writer:
            for text in warnings:
                writer.event(text)
            for number, row in enumerate(rows):
                report(len(rows) + number, 2 * len(rows), f"writing {row.file}")
                writer.append(_record(row, read_grey(images[row.file]).data, counts[row.camera]))
                counts[row.camera] += 1
    except BaseException:
        out.unlink(missing_ok=True)  # the images are still there; half an import is of no use
        raise
    return writer.uuid


def _record(row: ManifestRow, data: NDArray[np.uint8] | NDArray[np.uint16], frame_id: int) -> FrameRecord:
    time_ns = 0 if math.isnan(row.time_s) else round(row.time_s * _NS_PER_S)
    position = row.target_position
    if position is None and row.phase in _CORNERS:
        position = 0
    y_mm = row.y_mm
    if math.isnan(y_mm) and position is not None and row.phase in _CALIBRATION:
        y_mm = position * POSITION_STEP_MM
    return FrameRecord(
        camera=row.camera,
        phase=row.phase,
        data=data,
        frame_id=frame_id,
        camera_time_ns=time_ns,
        host_time_ns=time_ns,
        target_position=position,
        y_mm=y_mm,
        rotation_deg=row.rotation_deg,
        pressure_kpa=row.pressure_kpa,
        time_s=row.time_s,
    )


def _lacks_y(row: ManifestRow) -> bool:
    """Whether a row's displacement has to come from its position (at POS.0 it is zero by definition)."""
    return row.phase in _CALIBRATION and math.isnan(row.y_mm) and bool(row.target_position)


def _line(problem: Problem) -> int:
    """The line of a problem, so that they are listed as they stand in the manifest."""
    _, _, line = problem.where.rpartition(":")
    return int(line) if line.isdigit() else 0
