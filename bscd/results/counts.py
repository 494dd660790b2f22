"""How many points of frames are valid, how many extrapolated, how many lost and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from bscd.results.records import FrameResult


@dataclass(frozen=True)
class PointCounts:
    """Points counted over frames; ``lost`` by status code. Extrapolated ones are neither valid nor lost."""

    valid: int
    extrapolated: int
    lost: Mapping[int, int]

    @property
    def total(self) -> int:
        """All points of all frames."""
        return self.valid + self.extrapolated + sum(self.lost.values())

    def text(self, status_names: Mapping[int, str]) -> str:
        """In words, like ``980 valid (98.0 %), 5 extrapolated, 15 lost (12 low_zncc, 3 outside)``."""
        share = f" ({100.0 * self.valid / self.total:.1f} %)" if self.total else ""
        reasons = ", ".join(
            f"{count} {status_names[code]}" for code, count in sorted(self.lost.items(), key=lambda c: -c[1])
        )
        lost = f"{sum(self.lost.values())} lost" + (f" ({reasons})" if reasons else "")
        return f"{self.valid} valid{share}, {self.extrapolated} extrapolated, {lost}"


def count_points(frames: Iterable[FrameResult]) -> PointCounts:
    """Count the points of frames, one frame at a time."""
    valid = extrapolated = 0
    lost: Counter[int] = Counter()
    for frame in frames:
        valid += int(np.count_nonzero(frame.valid))
        extrapolated += int(np.count_nonzero(frame.extrapolated))
        lost.update(frame.status[~frame.valid & ~frame.extrapolated].tolist())
    return PointCounts(valid, extrapolated, dict(lost))
