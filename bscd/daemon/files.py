"""The data folder: runs, calibrations, results and reports by name; nothing that a client sends leads out of it."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from bscd import acquisition, calibration, results
from bscd.daemon.documents import FileDocument
from bscd.daemon.errors import UnknownNameError
from bscd.errors import BscdError, InputError

FileKind = Literal["run", "calibration", "result", "report"]
KINDS: tuple[FileKind, ...] = ("run", "calibration", "result", "report")

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,119}")
_FOLDERS: Mapping[FileKind, str] = {
    "run": "runs",
    "calibration": "calibrations",
    "result": "results",
    "report": "reports",
}

#: The page in a report's folder.
REPORT_PAGE = "report.html"


class DataFolder:
    """The folders of one daemon, made where they are missing. Safe to use from any thread.

    Raises `InputError` where it can not be written.
    """

    def __init__(self, root: Path) -> None:
        self.root = root.absolute()
        try:
            for folder in _FOLDERS.values():
                (self.root / folder).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{self.root}: the data folder can not be made ({error}); change data_folder") from error
        self._lock = threading.Lock()
        self._known: dict[Path, tuple[tuple[int, int], FileDocument]] = {}

    def new(self, kind: FileKind, name: str) -> Path:
        """Where something new of that name goes. Raises `InputError` when there is one already, or for a bad name."""
        if _NAME.fullmatch(name) is None:
            raise InputError(f"{name!r}: is no name; use letters, digits, - and _, 120 at most")
        path = self._place(kind, name)
        if path.exists():
            raise InputError(f"{kind} {name}: exists already; nothing is overwritten, choose another name")
        return path

    def folder(self, kind: FileKind) -> Path:
        """Where all of a kind are."""
        return self.root / _FOLDERS[kind]

    def has(self, kind: FileKind, name: str) -> bool:
        """Whether something of that name is there, whole or not."""
        return _NAME.fullmatch(name) is not None and self._place(kind, name).exists()

    def path(self, kind: FileKind, name: str) -> Path:
        """The file of that name (a report's page). Raises `UnknownNameError`."""
        if _NAME.fullmatch(name) is not None:
            path = self._place(kind, name)
            path = path / REPORT_PAGE if kind == "report" else path
            if path.is_file() and path.resolve().is_relative_to(self.root.resolve()):
                return path
        raise UnknownNameError(f"{kind} {name[:120]!r}: there is none of that name")

    def report_file(self, name: str, file: str) -> Path:
        """A file of a report. Raises `UnknownNameError`."""
        folder = self.path("report", name).parent
        path = (folder / file).resolve()
        if not path.is_file() or not path.is_relative_to(folder.resolve()):
            raise UnknownNameError(f"report {name}: has no file {file[:120]!r}")
        return path

    def list(self, kind: FileKind) -> list[FileDocument]:
        """All of a kind, newest first."""
        folder = self.root / _FOLDERS[kind]
        pattern = f"*/{REPORT_PAGE}" if kind == "report" else "*.h5"
        found = [self._document(kind, path) for path in folder.glob(pattern) if not path.name.startswith(".")]
        return sorted((one for one in found if one is not None), key=lambda one: one.modified_at, reverse=True)

    def about(self, kind: FileKind, name: str) -> FileDocument:
        """One of them. Raises `UnknownNameError`."""
        document = self._document(kind, self.path(kind, name))
        if document is None:
            raise UnknownNameError(f"{kind} {name}: is gone")
        return document

    def _place(self, kind: FileKind, name: str) -> Path:
        return self.root / _FOLDERS[kind] / (name if kind == "report" else f"{name}.h5")

    def _document(self, kind: FileKind, path: Path) -> FileDocument | None:
        try:
            stat = path.stat()
        except OSError:  # removed since it was listed
            return None
        stamp = (stat.st_mtime_ns, stat.st_size)
        with self._lock:
            known = self._known.get(path)
        if known is not None and known[0] == stamp:
            return known[1]
        about, problem = _about(kind, path)
        document = FileDocument(
            name=path.parent.name if kind == "report" else path.stem,
            kind=kind,
            bytes=stat.st_size,
            modified_at=datetime.fromtimestamp(stat.st_mtime, UTC),
            about=about,
            problem=problem,
        )
        with self._lock:
            self._known[path] = (stamp, document)
        return document


def _about(kind: FileKind, path: Path) -> tuple[dict[str, Any], str]:
    try:
        return _READERS[kind](path), ""
    except (BscdError, OSError, ValueError, KeyError) as error:
        return {}, str(error)


def _of_run(path: Path) -> dict[str, Any]:
    with acquisition.RunFile(path) as run:
        return {
            "title": run.title,
            "uuid": run.uuid,
            "start_time": run.header.start_time,
            "cameras": list(run.cameras),
            "frames": len(run.table()),
            "lost": sum(loss.count for loss in run.losses),
            "checksum": run.checksum,
            "state": run.state.name.lower(),
        }


def _of_calibration(path: Path) -> dict[str, Any]:
    made = calibration.Calibration.load(path)
    figures = {name: value for name, value in made.figures.items() if value == value}  # NaN is not JSON
    return {"checksum": made.checksum, "origins": _short(made.origins), "figures": figures}


def _of_result(path: Path) -> dict[str, Any]:
    with results.ResultsFile(path) as opened:
        header = opened.header
        return {
            "title": header.title,
            "uuid": opened.uuid,
            "run": header.run.file_name,
            "calibration": header.calibration.file_name,
            "frames": len(opened),
            "points": len(opened.points_px),
            "parameters": json.loads(header.parameters_json()),
        }


def _of_report(path: Path) -> dict[str, Any]:
    return {"files": sorted(one.name for one in path.parent.iterdir() if one.is_file())}


def _short(origins: Mapping[str, str]) -> dict[str, str]:
    """Without the whole configurations and recipes."""
    return {name: text for name, text in origins.items() if not name.endswith(("_configuration", "_recipe"))}


_READERS: Mapping[FileKind, Callable[[Path], dict[str, Any]]] = {
    "run": _of_run,
    "calibration": _of_calibration,
    "result": _of_result,
    "report": _of_report,
}
