"""An image in shared memory: written once, read by any process of this computer."""

from __future__ import annotations

import math
import os
import secrets
from dataclasses import dataclass
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Where Linux shows blocks of shared memory.
_FOLDER = Path("/dev/shm")  # noqa: S108 - not a place for temporary files of ours


@dataclass(frozen=True)
class SharedImage:
    """Where an image ``shape`` of ``dtype`` is; the process that made it releases it."""

    name: str
    shape: tuple[int, ...]
    dtype: str

    @classmethod
    def holding(cls, image: NDArray[Any]) -> SharedImage:
        """A copy of an image in shared memory of its own."""
        # whose it is can be seen in its name
        name = f"bscd-{os.getpid()}-{secrets.token_hex(8)}"
        block = SharedMemory(name, create=True, size=max(image.nbytes, 1))
        np.ndarray(image.shape, image.dtype, buffer=block.buf)[:] = image
        made = cls(block.name, image.shape, image.dtype.str)
        block.close()
        return made

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
