"""Look at every image that a manifest names before anything is written: what is wrong, what is worth knowing."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bscd.acquisition.images import SUFFIXES, read_grey
from bscd.acquisition.manifest import MANIFEST, ManifestRow
from bscd.acquisition.names import CAMERAS, CameraName
from bscd.acquisition.problems import Problem
from bscd.acquisition.records import CameraMeta
from bscd.errors import InputError

_NAMES_SHOWN = 5

#: Cameras' depths that 16-bit files hold; the pixels may use the lower bits only.
_DEPTHS = (10, 12, 14, 16)


@dataclass(frozen=True, slots=True)
class SeenImage:
    """What the first look at an image showed."""

    shape: tuple[int, ...]
    dtype: np.dtype[np.generic]
    from_colour: bool
    largest: int

    def __str__(self) -> str:
        """Size and depth, as a message names them."""
        return f"{self.shape[1]} x {self.shape[0]} px, {8 * self.dtype.itemsize} bit"


def look_at(row: ManifestRow, path: Path, folder: Path) -> SeenImage | Problem:
    """Read a row's image; what it is, or what is wrong with it."""
    where = f"{MANIFEST}:{row.line}"
    if not path.resolve().is_relative_to(folder.resolve()):
        return Problem(where, f"file {row.file} is a link out of the folder; copy the image into it")
    try:
        image = read_grey(path)
    except InputError as err:
        return Problem(where, f"file {row.file} {err}")
    return SeenImage(image.data.shape, image.data.dtype, image.from_colour, int(image.data.max()))


def cameras_of(
    rows: Sequence[ManifestRow], seen: Mapping[str, SeenImage]
) -> tuple[dict[CameraName, CameraMeta], list[Problem]]:
    """Each camera as most of its images show it, and the images that differ.

    A camera of 16-bit files has the smallest usual depth that holds the grey levels of all its images.
    """
    cameras: dict[CameraName, CameraMeta] = {}
    problems: list[Problem] = []
    for camera in CAMERAS:
        mine = [row for row in rows if row.camera == camera and row.file in seen]
        if not mine:
            continue
        sizes = Counter(str(seen[row.file]) for row in mine)
        usual, _ = sizes.most_common(1)[0]
        for row in mine:
            if str(seen[row.file]) != usual:
                what = f"file {row.file} is {seen[row.file]}, the {camera} camera's others are {usual}"
                problems.append(Problem(f"{MANIFEST}:{row.line}", what))
        one = next(seen[row.file] for row in mine if str(seen[row.file]) == usual)
        largest = max(seen[row.file].largest for row in mine)
        depth = 8 if one.dtype == np.uint8 else next(bits for bits in _DEPTHS if largest < 2**bits)
        cameras[camera] = CameraMeta(one.shape[1], one.shape[0], bit_depth=depth)
    return cameras, problems


def remarks(rows: Sequence[ManifestRow], images: Mapping[str, Path], seen: Mapping[str, SeenImage]) -> list[str]:
    """What the operator should know of an import in which nothing is wrong."""
    named = {row.file for row in rows}
    unnamed = [name for name in images if name not in named and name.lower().endswith(SUFFIXES)]
    coloured = [row.file for row in rows if seen[row.file].from_colour]
    lossy = [row.file for row in rows if row.file.lower().endswith((".jpg", ".jpeg"))]
    said = []
    if unnamed:
        said.append(f"{MANIFEST} does not name {_listed(unnamed)} in the folder; not imported")
    if coloured:
        said.append(f"{_listed(coloured)} in colour became grey (Rec. 601 luma)")
    if lossy:
        said.append(f"{_listed(lossy)} in JPEG lost detail when saved; PNG or TIFF keep what was measured")
    if back := _time_goes_back(rows):
        said.append(f"time_s goes back in line {back.line} of {MANIFEST}; frames stand in the manifest's order")
    return said


def _time_goes_back(rows: Sequence[ManifestRow]) -> ManifestRow | None:
    latest: dict[str, float] = {}
    for row in rows:
        if row.phase == "inflation" and not math.isnan(row.time_s):
            if row.time_s < latest.get(row.camera, -math.inf):
                return row
            latest[row.camera] = row.time_s
    return None


def _listed(names: Sequence[str]) -> str:
    count = f"{len(names)} images" if len(names) > 1 else "1 image"
    more = ", ..." if len(names) > _NAMES_SHOWN else ""
    return f"{count} ({', '.join(names[:_NAMES_SHOWN])}{more})"
