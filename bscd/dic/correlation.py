"""What a correlation gives: displacements, how sure they are, and why points failed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import BoolArray, FloatArray, IntArray


class Status(IntEnum):
    """Whether a point was matched, or why not."""

    VALID = 0
    OUTSIDE = 1
    """The point, or too much of its subset, is outside the reference, the current image or a mask."""
    LOW_TEXTURE = 2
    """The subset has too little contrast to place it."""
    NOT_CONVERGED = 3
    LOW_ZNCC = 4
    """The best match is not similar enough to be believed."""
    DIVERGED = 5
    """The iteration ran away from its initial guess."""
    NO_GUESS = 6
    """Nothing gave an initial guess."""


class GuessSource(IntEnum):
    """Where a point's initial guess came from, the cheapest first."""

    NONE = 0
    GIVEN = 1
    PROPAGATED = 2
    """From a matched neighbour's displacement and gradients."""
    FLOW = 3
    """Dense optical flow (DIS)."""
    FEATURES = 4
    """Matched features (SIFT)."""
    SEARCH = 5
    """Search for the highest ZNCC in a window about the best guess."""


@dataclass(frozen=True)
class Correlation:
    """Where N points of the reference are in the current image.

    ``displacement_px`` ``(N, 2)`` (column, row) and ``sigma_px`` ``(N, 2)`` its standard uncertainty,
    ``covariance_px2`` ``(N, 2, 2)`` the same with the correlation of the two; ``gradient`` ``(N, 2, 2)``:
    d displacement[i] / d position[j]; ``shape`` ``(N, P)`` all parameters of the shape function
    (u, ux, uy, v, vx, vy, or u, ux, uy, uxx, uxy, uyy and those of v). ``zncc``, ``residual_grey`` (standard
    deviation of the difference that remains, a pixel), ``pixels`` (of the subset that took part) ``(N,)``;
    ``iterations``, ``status`` (`Status`) and ``guess`` (`GuessSource`) ``(N,)``. All is NaN where a point is not
    valid, but for ``zncc``, which stays for points that were refused for it. ``noise_grey`` is the noise of the
    reference and the current image that the uncertainty rests on.
    """

    displacement_px: FloatArray
    sigma_px: FloatArray
    covariance_px2: FloatArray
    gradient: FloatArray
    shape: FloatArray
    zncc: FloatArray
    residual_grey: FloatArray
    pixels: NDArray[np.int64]
    iterations: NDArray[np.int32]
    status: NDArray[np.int32]
    guess: NDArray[np.int8]
    noise_grey: tuple[float, float] = field(default=(float("nan"), float("nan")))

    @property
    def valid(self) -> BoolArray:
        """Which points were matched, ``(N,)``."""
        return self.status == Status.VALID

    @property
    def failures(self) -> Mapping[Status, int]:
        """How many points failed, by reason."""
        counts = np.bincount(self.status, minlength=len(Status))
        return {status: int(counts[status]) for status in Status if status and counts[status]}

    @property
    def guesses(self) -> Mapping[GuessSource, int]:
        """How many points started from which guess."""
        counts = np.bincount(self.guess, minlength=len(GuessSource))
        return {source: int(counts[source]) for source in GuessSource if counts[source]}

    def only(self, which: BoolArray) -> Correlation:
        """Some of the points, ``which`` ``(N,)``."""
        return replace(self, **{name: values[which] for name, values in self._by_point().items()})

    def updated(self, index: IntArray, other: Correlation) -> Correlation:
        """With the rows ``index`` ``(n,)`` taken from another match of those points."""
        theirs, ours = other._by_point(), {name: values.copy() for name, values in self._by_point().items()}
        for name, values in ours.items():
            values[index] = theirs[name]
        return replace(self, **ours)

    def _by_point(self) -> dict[str, NDArray]:
        return {entry.name: getattr(self, entry.name) for entry in fields(self) if entry.name != "noise_grey"}
