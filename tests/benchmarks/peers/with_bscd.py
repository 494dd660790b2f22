"""Our own correlator, behind the same process and protocol as the peers."""

from __future__ import annotations

from typing import Any

import numpy as np

from bscd.dic import correlate as bscd_correlate


def correlate(reference: np.ndarray, current: np.ndarray, points: np.ndarray, job: dict[str, Any], threads: int) -> Any:
    return bscd_correlate(
        reference, current, points.astype(np.float64), subset_px=job["subset_px"], threads=threads, **job["options"]
    )


def answer(raw: Any, points: np.ndarray, job: dict[str, Any]) -> dict[str, np.ndarray]:
    return {"displacement_px": raw.displacement_px, "valid": raw.valid, "sigma_px": raw.sigma_px}
