"""Frames in memory that several processes see: the owner's buffers, a handle that travels, a reader's window.

The memory has no name in the file system: it is a descriptor of its owner, which others of the same user open
through ``/proc``. So it goes with the last process that uses it, also when one is killed.
"""

from __future__ import annotations

import mmap
import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike, NDArray

Pixels = NDArray[np.uint8] | NDArray[np.uint16]

_LABEL = "bscd-frames"


@dataclass(frozen=True, slots=True)
class SharedFrame:
    """Where one frame is: small, picklable, valid until the frame is released.

    ``name`` opens the memory, ``slot`` is the buffer in it, ``shape`` (height, width) and ``dtype`` ("uint8" or
    "uint16") the image; ``number`` is the exposure's, from 0.
    """

    name: str
    slot: int
    shape: tuple[int, int]
    dtype: str
    number: int


class SharedBuffers:
    """Preallocated buffers of one image size; the process that makes them writes, any other reads.

    Parameters
    ----------
    slots
        How many images fit.
    shape
        Height and width of an image, px.
    dtype
        uint8 or uint16.
    """

    def __init__(self, slots: int, shape: tuple[int, int], dtype: DTypeLike) -> None:
        self.shape = shape
        self.dtype = np.dtype(dtype)
        self.slots = slots
        size = slots * shape[0] * shape[1] * self.dtype.itemsize
        self._descriptor = os.memfd_create(_LABEL)
        try:
            os.posix_fallocate(self._descriptor, 0, size)  # now, not frame by frame, and an error, not a signal
            pages = mmap.mmap(self._descriptor, size, mmap.MAP_SHARED | mmap.MAP_POPULATE)
        except BaseException:
            os.close(self._descriptor)
            raise
        self._images = np.frombuffer(pages, self.dtype).reshape(slots, *shape)
        self.name = f"/proc/{os.getpid()}/fd/{self._descriptor}"

    def view(self, slot: int) -> Pixels:
        """One buffer, ``(height, width)``, not copied."""
        return self._images[slot]

    def handle(self, slot: int, number: int) -> SharedFrame:
        """How another process finds the image in a buffer."""
        return SharedFrame(self.name, slot, self.shape, self.dtype.name, number)

    def close(self) -> None:
        """Let go of the memory; it is freed with the last view of it. May be called twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
            self._images = np.empty((0, *self.shape), self.dtype)


class FrameWindow:
    """Another process's frames, read where they are; keeps the memory open between calls."""

    def __init__(self) -> None:
        self._pages: dict[str, mmap.mmap] = {}

    def view(self, frame: SharedFrame) -> Pixels:
        """The image ``(height, width)``, read-only, not copied. Raises `FileNotFoundError` when its owner is gone."""
        if frame.name not in self._pages:
            self._pages[frame.name] = _opened(frame.name)
        dtype, count = np.dtype(frame.dtype), frame.shape[0] * frame.shape[1]
        offset = frame.slot * count * dtype.itemsize
        return np.frombuffer(self._pages[frame.name], dtype, count, offset).reshape(frame.shape)

    def close(self) -> None:
        """Forget the memory; it is freed with the last view of it. May be called twice."""
        self._pages.clear()


def _opened(name: str) -> mmap.mmap:
    if not os.readlink(name).startswith(f"/memfd:{_LABEL}"):  # the owner closed it and has another file there now
        raise FileNotFoundError(f"{name}: these frames are gone")
    descriptor = os.open(name, os.O_RDONLY)
    try:
        return mmap.mmap(descriptor, 0, access=mmap.ACCESS_READ)
    finally:
        os.close(descriptor)
