"""The pressure at a frame, from the log of readings around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def interpolate_log_kpa(
    host_time_ns: NDArray[np.int64], log_time_ns: NDArray[np.int64], log_kpa: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Linear between the two readings around each time ``(N,)``; NaN before the first and after the last.

    Both times are of the host's clock; the log ``(M,)`` is in the order read.
    """
    if len(log_time_ns) == 0:
        return np.full(len(host_time_ns), np.nan)
    start_ns = int(log_time_ns[0])  # differences first: ns since 1970 do not fit a float64 exactly
    at_s = (np.asarray(host_time_ns, np.int64) - start_ns).astype(np.float64)
    log_s = (np.asarray(log_time_ns, np.int64) - start_ns).astype(np.float64)
    return np.interp(at_s, log_s, np.asarray(log_kpa, np.float64), left=np.nan, right=np.nan)
