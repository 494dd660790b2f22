"""The folder that an export goes to: nothing in it is overwritten, and an export that fails leaves nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from bscd.errors import BscdError, InputError
from bscd.results.reader import ResultsFile
from bscd.results.records import FrameResult

ExportProgress = Callable[[int, int, str], None]
"""Called with how many frames are done, of how many, and what was done last."""


@contextmanager
def exporting(folder: Path, patterns: Sequence[str]) -> Iterator[None]:
    """Make the folder for files with names like ``patterns``.

    Raises
    ------
    InputError
        The folder holds such a file, or can not be made.
    BscdError
        Writing failed.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file, not a folder; choose another name")
    if taken := sorted(path for pattern in patterns for path in folder.glob(pattern)):
        raise InputError(f"{taken[0]} exists already and nothing is overwritten; choose a new or empty folder")
    new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        raise InputError(f"{folder} can not be made a folder ({err.strerror}); choose another name") from err
    try:
        yield
    except BaseException as err:
        for path in [path for pattern in patterns for path in folder.glob(pattern)]:
            path.unlink(missing_ok=True)
        if new:
            with suppress(OSError):  # somebody else has put something there meanwhile
                folder.rmdir()
        if isinstance(err, OSError):
            raise BscdError(f"{folder}: writing failed ({err.strerror}); make room and export again") from err
        raise


def frames_to_export(results: ResultsFile, progress: ExportProgress | None) -> Iterator[FrameResult]:
    """The frames one at a time, their progress reported; raises `InputError` when there is none."""
    count = len(results)
    if count == 0:
        raise InputError(f"{results.path} holds no frame; measure one first")
    for index in range(count):
        frame = results.frame(index)
        yield frame
        if progress is not None:
            progress(index + 1, count, f"frame {frame.number}")
