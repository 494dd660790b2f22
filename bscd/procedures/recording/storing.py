"""How a recording is put on the disk."""

from __future__ import annotations

from dataclasses import dataclass

from bscd.acquisition import Compression


@dataclass(frozen=True, slots=True)
class Storing:
    """How a recording is put on the disk: see `bscd.acquisition.RunWriter`.

    ``flush_s`` is how much of it a crash may cost; ``ring_frames`` how many frames wait in memory for a slow disk.
    """

    compression: Compression = "none"
    flush_s: float = 1.0
    sync: bool = True
    reserve_bytes: int = 64_000_000
    ring_frames: int = 64
