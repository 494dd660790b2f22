"""How a recording is put on the disk."""

from __future__ import annotations

from dataclasses import dataclass

from bscd.acquisition import Compression


@dataclass(frozen=True, slots=True)
class Storing:
    """How a recording is put on the disk: see `bscd.acquisition.RunWriter`.

    ``flush_s`` is how much of it a crash may cost; ``ring_frames`` how many frames wait in memory for a slow disk.
    ``reserve_bytes`` of the disk are left free; ``beside_bytes`` is what others will write there meanwhile, and what
    is not left for it before it begins is refused.
    """

    compression: Compression = "none"
    flush_s: float = 1.0
    sync: bool = True
    reserve_bytes: int = 64_000_000
    beside_bytes: int = 0
    ring_frames: int = 64
