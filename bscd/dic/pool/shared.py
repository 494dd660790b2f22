"""An image in shared memory: written once, read by any process of this computer."""

from __future__ import annotations

from dataclasses import dataclass
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class SharedImage:
    """Where an image ``shape`` of ``dtype`` is; the process that made it releases it."""

    name: str
    shape: tuple[int, ...]
    dtype: str

    @classmethod
    def holding(cls, image: NDArray[Any]) -> SharedImage:
        """A copy of an image in shared memory of its own."""
        block = SharedMemory(create=True, size=max(image.nbytes, 1))
        np.ndarray(image.shape, image.dtype, buffer=block.buf)[:] = image
        made = cls(block.name, image.shape, image.dtype.str)
        block.close()
        return made

    def read(self) -> NDArray[Any]:
        """An own copy."""
        block = SharedMemory(self.name)
        try:
            return np.array(np.ndarray(self.shape, self.dtype, buffer=block.buf))
        finally:
            block.close()

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
