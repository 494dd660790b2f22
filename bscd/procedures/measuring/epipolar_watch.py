"""Tell when epipolar residuals say that the rig has moved since its calibration."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bscd.arrays import FloatArray
from bscd.procedures.measuring.sequence import Measured, PointStatus

#: A frame with fewer matches than this part of the reference's shows too little to judge the rig by.
_LEAST_PART = 0.2

#: So large a part of the matches is nearly all of them.
_NEARLY_ALL = 0.9


class EpipolarWatch:
    """Looks at the reference, then at each frame, and tells each of two things once.

    That the median residual of the matches is above ``limit_px`` (None: nothing is known to hold it against), and that
    nearly all matches are refused since theirs is above ``refused_px``. ``moved`` names what must have moved.
    """

    def __init__(
        self,
        reference: Measured,
        *,
        limit_px: float | None,
        refused_px: float,
        moved: str,
        warn: Callable[[str], None],
    ) -> None:
        self.refused_px = refused_px
        self._limit_px, self._moved, self._warn = limit_px, moved, warn
        self._told_moved = self._told_refused = False
        self._least = max(1.0, _LEAST_PART * len(_residuals(reference)))
        self._judge(reference, "in the reference", "calibrate again")

    def look(self, number: int, measured: Measured) -> None:
        """Judge the frame of this number."""
        self._judge(
            measured,
            f"from frame {number} on",
            "calibrate again (epipolar_median_px in the results says which frames it shows in)",
        )

    def _judge(self, measured: Measured, when: str, advice: str) -> None:
        residuals = _residuals(measured)
        if len(residuals) < self._least:
            return
        median = float(np.median(residuals))
        if self._limit_px is not None and median > self._limit_px and not self._told_moved:
            self._told_moved = True
            self._warn(
                f"{when} the median epipolar residual is {median:.2f} px (limit {self._limit_px:g}): {self._moved} "
                f"moved since the calibration; {advice}"
            )
        refused = int(np.count_nonzero(measured.status == PointStatus.EPIPOLAR))
        if refused > _NEARLY_ALL * len(residuals) and not self._told_refused:
            self._told_refused = True
            self._warn(
                f"{when} {refused} of {len(residuals)} points that match are refused (status epipolar), more than "
                f"{self.refused_px:g} px beside their epipolar lines"
            )


def _residuals(measured: Measured) -> FloatArray:
    """Of the points that match in both views, ``(n,)``."""
    return measured.epipolar_px[np.isfinite(measured.epipolar_px)]
