"""Read an import's manifest: one row an image, every row checked, all problems gathered."""

from __future__ import annotations

import csv
import io
import math
import posixpath
import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import cast

from bscd.acquisition.names import CAMERAS, PHASES, CameraName, PhaseName
from bscd.acquisition.problems import Problem, allowed_hint, shown

MANIFEST = "manifest.csv"
HEADER = ("file", "camera", "phase", "target_position", "y_mm", "rotation_deg", "pressure_kpa", "time_s")

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True, slots=True)
class ManifestRow:
    """One image of a manifest; ``file`` is relative to the folder, with ``/``; NaN and None where empty."""

    line: int
    file: str
    camera: CameraName
    phase: PhaseName
    target_position: int | None
    y_mm: float
    rotation_deg: float
    pressure_kpa: float
    time_s: float


def parse_manifest(text: str, images: Collection[str]) -> tuple[list[ManifestRow], list[Problem]]:
    """The rows of a manifest's text, and all that is wrong with it; with a problem the rows are not complete.

    ``images`` are the files that exist, relative to the folder, with ``/``.
    """
    lines = _Lines(text)
    header = next(lines, None)
    if header is None:
        return [], [*lines.problems, Problem(MANIFEST, f"it is empty; its first line must be {','.join(HEADER)}")]
    if problems := _header_problems(header[1]):
        return [], [*lines.problems, *problems]
    columns = [name.strip() for name in header[1]]
    rows: list[ManifestRow] = []
    problems: list[Problem] = []
    first_line_of: dict[str, int] = {}
    for line, cells in lines:
        if len(cells) != len(columns):
            what = f"{len(cells)} cells instead of {len(columns)}; numbers need a decimal point, not a comma"
            problems.append(Problem(f"{MANIFEST}:{line}", what))
            continue
        row = _Row(line, {name: cell.strip() for name, cell in zip(columns, cells, strict=True)})
        parsed = row.parse(images)
        if parsed.file and first_line_of.setdefault(parsed.file, line) != line:
            row.refuse("file", f"is already in line {first_line_of[parsed.file]}; name each image once")
        problems += row.problems
        rows.append(parsed)
    if not rows and not problems and not lines.problems:
        problems.append(Problem(MANIFEST, "it names no image; give a row for each"))
    return rows, [*problems, *lines.problems]


class _Lines:
    """The manifest's lines that are not blank, as (line number, cells); ends at a line that is no CSV."""

    def __init__(self, text: str) -> None:
        self._reader = csv.reader(io.StringIO(text, newline=""), strict=True)
        self.problems: list[Problem] = []

    def __iter__(self) -> _Lines:
        return self

    def __next__(self) -> tuple[int, list[str]]:
        while True:
            line = self._reader.line_num + 1
            try:
                cells = next(self._reader)
            except csv.Error as err:
                self.problems.append(Problem(f"{MANIFEST}:{line}", f"is not CSV ({err}); look at its quotes"))
                raise StopIteration from err
            if any(cell.strip() for cell in cells):
                return line, cells


def _header_problems(cells: list[str]) -> list[Problem]:
    where = f"{MANIFEST}:1"
    names = [name.strip() for name in cells]
    if len(names) == 1 and any(sign in names[0] for sign in ";\t"):
        return [Problem(where, "its columns are not separated by commas; save it as comma-separated values")]
    missing = [name for name in HEADER if name not in names]
    problems = [
        Problem(where, f"no column {shown(name)} is known; {allowed_hint(name, missing or HEADER)}")
        for name in names
        if name not in HEADER
    ]
    problems += [Problem(where, f"column {name} stands twice") for name in HEADER if names.count(name) > 1]
    if missing and not problems:
        problems.append(Problem(where, f"columns missing: {', '.join(missing)}; it must be {','.join(HEADER)}"))
    return problems


class _Row:
    """One row while it is checked."""

    def __init__(self, line: int, cells: dict[str, str]) -> None:
        self._line = line
        self._cells = cells
        self.problems: list[Problem] = []

    def refuse(self, column: str, why: str) -> None:
        """Note what is wrong with a cell."""
        self.problems.append(Problem(f"{MANIFEST}:{self._line}", f"{column} {shown(self._cells[column])} {why}"))

    def parse(self, images: Collection[str]) -> ManifestRow:
        """The row with what could be understood; the rest is in ``problems``."""
        phase = cast("PhaseName", self._choice("phase", PHASES))
        return ManifestRow(
            line=self._line,
            file=self._file(images),
            camera=cast("CameraName", self._choice("camera", CAMERAS)),
            phase=phase,
            target_position=self._position(phase),
            y_mm=self._number("y_mm"),
            rotation_deg=self._number("rotation_deg"),
            pressure_kpa=self._number("pressure_kpa"),
            time_s=self._number("time_s"),
        )

    def _file(self, images: Collection[str]) -> str:
        given = self._cells["file"]
        if not given:
            self.refuse("file", "is empty; name the image")
            return ""
        path = posixpath.normpath(given.replace("\\", "/"))
        if path.startswith(("/", "../")) or path == ".." or re.match("[A-Za-z]:", path):
            self.refuse("file", "lies outside the folder; copy the image into it and name it relative to it")
            return ""
        if path not in images:
            near = allowed_hint(path, images) if len(images) <= 5000 else ""
            self.refuse("file", f"is not in the folder{'; ' + near if near.startswith('did') else ''}")
            return ""
        return path

    def _choice(self, column: str, allowed: Collection[str]) -> str:
        value = self._cells[column]
        if value not in allowed:
            self.refuse(column, f"is not a {column}; {allowed_hint(value, allowed)}")
        return value

    def _number(self, column: str) -> float:
        cell = self._cells[column]
        if not cell:
            return math.nan
        value = float(cell) if _NUMBER.fullmatch(cell) else math.nan
        if not math.isfinite(value):
            self.refuse(column, "is not a number; allowed: a decimal number such as -2.5, or nothing")
            return math.nan
        return value

    def _position(self, phase: PhaseName) -> int | None:
        before = len(self.problems)
        value = self._number("target_position")
        if len(self.problems) > before:
            return None
        if math.isnan(value):
            if phase in ("reference-face", "bsc-face"):
                self.refuse("target_position", f"is empty, but a {phase} image needs the k of its POS.k")
            return None
        if not value.is_integer() or abs(value) > 1000:
            self.refuse("target_position", "is not the k of a POS.k; allowed: whole numbers such as -8 or 3")
            return None
        return int(value)
