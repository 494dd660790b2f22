"""Which frames of the two cameras of the standard pair were taken together."""

from __future__ import annotations

import numpy as np

from bscd.arrays import FloatArray, IntArray

#: How far the times of two frames that were taken together may be apart, in shortest intervals between frames.
_APART = 0.25


def taken_together(primary_s: FloatArray, auxiliary_s: FloatArray) -> IntArray | None:
    """For each frame of the primary camera the place of the auxiliary one's, ``(T,)``; -1 where there is none.

    By the times ``(T,)`` and ``(M,)`` where they tell, else by the order recorded; None where counts leave that open.
    """
    by_time = _by_time(primary_s, auxiliary_s)
    if by_time is not None:
        return by_time
    return np.arange(len(primary_s)) if len(primary_s) == len(auxiliary_s) else None


def _by_time(primary_s: FloatArray, auxiliary_s: FloatArray) -> IntArray | None:
    """None where times are missing, not each frame's own, or not both cameras'."""
    known = np.flatnonzero(np.isfinite(auxiliary_s))
    if not len(known) or not np.isfinite(primary_s).all() or not (_own(primary_s) and _own(auxiliary_s[known])):
        return None
    intervals = np.diff(np.sort(primary_s))
    tolerance_s = _APART * float(intervals.min()) if len(intervals) else 0.0
    known = known[np.argsort(auxiliary_s[known])]
    times_s = auxiliary_s[known]
    after = np.searchsorted(times_s, primary_s)
    earlier, later = np.maximum(after - 1, 0), np.minimum(after, len(known) - 1)
    nearest = np.where(np.abs(primary_s - times_s[earlier]) < np.abs(primary_s - times_s[later]), earlier, later)
    together = np.abs(primary_s - times_s[nearest]) <= tolerance_s
    return np.where(together, known[nearest], -1) if together.any() else None


def _own(times_s: FloatArray) -> bool:
    return len(np.unique(times_s)) == len(times_s)
