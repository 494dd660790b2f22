"""What a replay camera shows: the images of a folder or the frames of a run, one after the other."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bscd.acquisition.images import SUFFIXES, read_grey
from bscd.acquisition.reader import RunFile
from bscd.acquisition.records import CameraMeta
from bscd.acquisition.replay.options import ReplayOptions
from bscd.errors import InputError
from drivers.interfaces import FrameStatus


@dataclass(frozen=True, slots=True)
class RecordedImage:
    """An image as it was recorded; ``frame_id`` jumps where one was lost, ``time_s`` counts from any start."""

    data: NDArray[np.uint8] | NDArray[np.uint16]
    frame_id: int
    time_s: float
    status: FrameStatus = FrameStatus.OK


class Recording(Protocol):
    """Images of one camera."""

    camera: CameraMeta
    """Size, depth and identity."""

    def images(self) -> Iterator[RecordedImage]:
        """The images from the first on, each read when its turn comes. Raises `InputError`."""
        ...

    def close(self) -> None:
        """Let go of the file."""
        ...


def open_recording(options: ReplayOptions) -> Recording:
    """The recording that the options name. Raises `InputError` when there is none."""
    return FolderRecording(options) if options.source.is_dir() else RunRecording(options)


class FolderRecording:
    """The images of a folder in the order of their names, numbers by their value; as far apart as the rate says."""

    def __init__(self, options: ReplayOptions) -> None:
        files = [path for path in options.source.iterdir() if path.suffix.lower() in SUFFIXES]
        if not files:
            raise InputError(f"{options.source} holds no image; allowed: {', '.join(s[1:] for s in SUFFIXES)}")
        self._files = sorted(files, key=_natural)
        self._period_s = 1.0 / options.frame_rate_hz
        first = _read(self._files[0])
        depth = options.bit_depth or 8 * first.dtype.itemsize
        if depth > 8 and first.dtype == np.uint8:
            raise InputError(f"{self._files[0]} has 8 bits; leave bit_depth out")
        self.camera = CameraMeta(
            first.shape[1], first.shape[0], bit_depth=depth, vendor="files", model="folder", serial=options.source.name
        )

    def images(self) -> Iterator[RecordedImage]:
        """The images; one of another size or depth than the first raises `InputError`."""
        for number, path in enumerate(self._files):
            data = _read(path)
            size = (self.camera.height_px, self.camera.width_px)
            if data.shape != size or data.dtype != self.camera.dtype or int(data.max()) >= 2**self.camera.bit_depth:
                wanted = f"{size[1]} x {size[0]} pixels of {self.camera.bit_depth} bits"
                raise InputError(f"{path} differs from the first image, which has {wanted}")
            data.setflags(write=False)
            yield RecordedImage(data, number, number * self._period_s)

    def close(self) -> None:
        """Nothing stays open."""


class RunRecording:
    """The frames of one camera of a run, with their losses and their times."""

    def __init__(self, options: ReplayOptions) -> None:
        self._options = options
        self._run = RunFile(options.source)
        try:
            if options.camera not in self._run.cameras:
                has = ", ".join(self._run.cameras)
                raise InputError(f"{options.source} has no {options.camera} camera; it has {has}")
            if len(self._run.table(options.camera, options.phase)) == 0:
                phase = f" in phase {options.phase}" if options.phase else ""
                raise InputError(f"{options.source} has no frame of the {options.camera} camera{phase}")
        except BaseException:
            self._run.close()
            raise
        self.camera = self._run.cameras[options.camera]

    def images(self) -> Iterator[RecordedImage]:
        """The frames as they were recorded; their times are those of the camera."""
        for frame in self._run.frames(self._options.camera, self._options.phase):
            yield RecordedImage(frame.data, frame.frame_id, 1e-9 * frame.camera_time_ns, frame.status)

    def close(self) -> None:
        """Close the run file."""
        self._run.close()


def _read(path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    try:
        return read_grey(path).data
    except InputError as err:
        raise InputError(f"{path} {err}") from err


def _natural(path: Path) -> tuple[tuple[int, int | str], ...]:
    parts = re.split(r"(\d+)", path.name)
    return tuple((0, int(part)) if part.isdigit() else (1, part) for part in parts)
