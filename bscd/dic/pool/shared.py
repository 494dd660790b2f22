"""An image in shared memory: written once, read by any process of this computer."""

from __future__ import annotations

import math
import os
import secrets
import shutil
from dataclasses import dataclass
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bscd.errors import BscdError

#: Writing to shared memory that has run out would end the process (SIGBUS): so much stays free for others' writing.
_SPARE_BYTES = 4_000_000

#: Where Linux shows blocks of shared memory.
_FOLDER = Path("/dev/shm")  # noqa: S108 - not a place for temporary files of ours


class MemoryFullError(BscdError):
    """The computer's shared memory has no room."""


@dataclass(frozen=True)
class SharedImage:
    """Where an image ``shape`` of ``dtype`` is; the process that made it releases it."""

    name: str
    shape: tuple[int, ...]
    dtype: str

    @classmethod
    def holding(cls, image: NDArray[Any], *, leave_bytes: int = 0) -> SharedImage:
        """A copy of an image in shared memory of its own. Raises `MemoryFullError`.

        ``leave_bytes`` are left free for who needs them more.
        """
        needed = image.nbytes + leave_bytes + _SPARE_BYTES
        if _FOLDER.is_dir() and shutil.disk_usage(_FOLDER).free < needed:
            raise MemoryFullError(
                f"shared memory ({_FOLDER}) has no room for an image of {image.nbytes / 1e6:.1f} MB; "
                "remove what is left there, or give it more (in a container: --shm-size)"
            )
        # whose it is can be seen in its name
        name = f"bscd-{os.getpid()}-{secrets.token_hex(8)}"
        block = SharedMemory(name, create=True, size=max(image.nbytes, 1))
        np.ndarray(image.shape, image.dtype, buffer=block.buf)[:] = image
        made = cls(block.name, image.shape, image.dtype.str)
        block.close()
        return made

    @property
    def nbytes(self) -> int:
        """Its bytes."""
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize

    def read(self) -> NDArray[Any]:
        """An own copy."""
        # through the file, since whoever attaches to a block takes it away when it ends (CPython issue 82300)
        return np.fromfile(_FOLDER / self.name, self.dtype, math.prod(self.shape)).reshape(self.shape)

    def release(self) -> None:
        """Take it away; its name means nothing afterwards."""
        block = SharedMemory(self.name)
        block.close()
        block.unlink()


@dataclass(frozen=True, eq=False)
class OwnImage:
    """An image that travels with what names it."""

    image: NDArray[Any]

    def read(self) -> NDArray[Any]:
        """An own copy."""
        return self.image.copy()

    def release(self) -> None:
        """Nothing to give back."""
