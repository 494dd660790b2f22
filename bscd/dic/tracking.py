"""Track points of one view through a sequence, from each frame's result to the next; the reference is renewed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bscd.arrays import BoolArray, FloatArray
from bscd.dic.correlate import correlate
from bscd.dic.correlation import Correlation, Status
from bscd.dic.images import PreparedImage
from bscd.dic.recovery import Jump, recovered, trial_points
from bscd.dic.sharpness import sharpness_per_px
from bscd.dic.solver import ShapeName

#: A frame in which no more than this share of the points is found tells nothing of where they have gone.
_HOPELESS = 0.05

#: A frame less sharp than this share of the reference's sharpness becomes no reference, unless it stays so for so many.
_SHARP = 0.87
_PATIENCE = 3


@dataclass(frozen=True)
class TrackingSettings:
    """How points are tracked.

    The reference is renewed when the median ZNCC has fallen by ``zncc_fall`` of what the first frame reached, or when
    ``lost_share`` of the points that it had are without a match.
    """

    subset_px: int = 21
    shape: ShapeName = "affine"
    zncc_min: float = 0.7
    zncc_fall: float = 0.1
    lost_share: float = 0.02
    noise_grey: float | tuple[float, float] | None = None
    threads: int | None = None


@dataclass(frozen=True, eq=False)
class Tracked:
    """Where N points are in a frame.

    ``position_px`` ``(N, 2)``; ``covariance_px2`` ``(N, 2, 2)`` of it, all matches since the first reference
    together; ``gradient`` ``(N, 2, 2)`` of the displacement since the first reference by the position there; ``zncc``
    ``(N,)`` against the reference of the moment; ``status`` ``(N,)``; ``renewals`` how often it was renewed before.
    NaN where a point is not valid.
    """

    position_px: FloatArray
    covariance_px2: FloatArray
    gradient: FloatArray
    zncc: FloatArray
    status: NDArray[np.int32]
    renewals: int

    @property
    def valid(self) -> BoolArray:
        """Which points were found, ``(N,)``."""
        return self.status == Status.VALID


@dataclass
class _Generation:
    """A reference image and what the points had come to there; rows for all points, NaN for those not in it."""

    image: PreparedImage
    position_px: FloatArray
    covariance_px2: FloatArray
    gradient: FloatArray
    shape: FloatArray = field(init=False)
    """The last known shape parameters from here, ``(N, 6 or 12)``; NaN where there are none."""
    before: FloatArray = field(init=False)


class Tracker:
    """Follows points ``(N, 2)`` of a reference image through frames that are given one after the other."""

    def __init__(self, reference: PreparedImage, points_px: FloatArray, settings: TrackingSettings) -> None:
        count = len(points_px)
        self._settings = settings
        self._parameters = 6 if settings.shape == "affine" else 12
        self._points_px = np.array(points_px, np.float64).reshape(-1, 2)
        self._generations: dict[int, _Generation] = {}
        self._newest = -1
        self._of = np.zeros(count, np.int64)
        self._renewals = 0
        self._first_zncc = float("nan")
        self._last = Tracked(
            self._points_px,
            np.zeros((count, 2, 2)),
            np.zeros((count, 2, 2)),
            np.ones(count),
            np.zeros(count, np.int32),
            0,
        )
        self._previous = reference
        self._hopeless = False
        self._waited = 0
        self._jump = Jump(reference, reference)
        self._begin(reference, np.ones(count, bool))

    def track(self, current: PreparedImage) -> Tracked:
        """The points in the next frame."""
        self._jump = Jump(self._previous, current)
        found = self._matched(current)
        self._last = replace(found, renewals=self._renewals)
        self._hopeless = np.count_nonzero(found.valid) < _HOPELESS * len(self._of)
        if not self._hopeless:
            self._previous = current
            self._renew_where_needed(current, found)
        return self._last

    def _matched(self, current: PreparedImage) -> Tracked:
        count = len(self._of)
        nan = float("nan")
        whole = Tracked(
            np.full((count, 2), nan),
            np.full((count, 2, 2), nan),
            np.full((count, 2, 2), nan),
            np.full(count, nan),
            np.full(count, Status.NO_GUESS, np.int32),
            self._renewals,
        )
        for number, generation in self._generations.items():
            self._match_generation(generation, np.flatnonzero(self._of == number), current, whole)
        self._match_beside_neighbours(current, whole)
        return whole

    def _match_generation(
        self, generation: _Generation, mine: NDArray[np.int64], current: PreparedImage, whole: Tracked
    ) -> None:
        start = generation.position_px[mine]
        guess = self._predicted(generation, mine)
        if self._hopeless:  # a few will do to tell whether the surface is back
            guess[np.setdiff1d(np.arange(len(mine)), trial_points(start, self._settings.subset_px))] = np.nan
        result = self._correlate(generation, start, current, guess)
        if np.count_nonzero(~result.valid) > max(0.3 * len(mine), 20):
            result = self._recovered(generation, mine, current, result)
        generation.before[mine] = generation.shape[mine]
        self._take(generation, mine, result, whole)

    def _match_beside_neighbours(self, current: PreparedImage, whole: Tracked) -> None:
        """Try the points without a match where the nearest ones with a match, of any reference, say that they are."""
        lost = np.flatnonzero(~whole.valid)
        if not len(lost) or not whole.valid.any():
            return
        known = np.flatnonzero(whole.valid)
        beside = known[KDTree(self._points_px[known]).query(self._points_px[lost])[1]]
        deformation = np.eye(2) + whole.gradient[beside]
        offset = self._points_px[lost] - self._points_px[beside]
        place = whole.position_px[beside] + np.einsum("nij,nj->ni", deformation, offset)
        for number, generation in self._generations.items():
            here = self._of[lost] == number
            if not here.any():
                continue
            mine = lost[here]
            gradient = deformation[here] @ np.linalg.inv(np.eye(2) + generation.gradient[mine]) - np.eye(2)
            moved = place[here] - generation.position_px[mine]
            guess = np.column_stack([moved[:, 0], gradient[:, 0], moved[:, 1], gradient[:, 1]])
            result = self._correlate(generation, generation.position_px[mine], current, guess)
            self._take(generation, mine, result, whole)

    def _take(self, generation: _Generation, mine: NDArray[np.int64], result: Correlation, whole: Tracked) -> None:
        """Enter a generation's matches into the whole."""
        start = generation.position_px[mine]
        known = result.valid
        generation.shape[mine[known]] = result.shape[known]
        onward = np.eye(2) + result.gradient
        carried = onward @ generation.covariance_px2[mine] @ np.swapaxes(onward, 1, 2)
        whole.position_px[mine] = start + result.displacement_px
        whole.covariance_px2[mine] = result.covariance_px2 + carried
        whole.gradient[mine] = onward @ (np.eye(2) + generation.gradient[mine]) - np.eye(2)
        whole.zncc[mine] = result.zncc
        whole.status[mine] = result.status

    def _correlate(
        self, generation: _Generation, start: FloatArray, current: PreparedImage, guess: FloatArray, find: bool = False
    ) -> Correlation:
        settings = self._settings
        return correlate(
            generation.image,
            current,
            start,
            subset_px=settings.subset_px,
            guess_px=guess,
            find_guesses=find,
            shape=settings.shape,
            interpolation=current.spline,
            noise_grey=settings.noise_grey,
            zncc_min=settings.zncc_min,
            threads=settings.threads,
        )

    def _predicted(self, generation: _Generation, mine: NDArray[np.int64]) -> FloatArray:
        """Shape parameters of steady motion: the last ones and once more their last change."""
        last, before = generation.shape[mine], generation.before[mine]
        ahead = 2.0 * last - before
        return np.where(np.isfinite(ahead), ahead, last)

    def _recovered(
        self, generation: _Generation, mine: NDArray[np.int64], current: PreparedImage, first: Correlation
    ) -> Correlation:
        start = generation.position_px[mine]

        def attempt(index: NDArray[np.int64], guess: FloatArray) -> Correlation:
            return self._correlate(generation, start[index], current, guess)

        images = (generation.image, current)
        return recovered(first, start, generation.shape[mine], self._jump, images, self._settings.subset_px, attempt)

    def _renew_where_needed(self, current: PreparedImage, found: Tracked) -> None:
        valid = found.valid
        newest = self._of == self._newest
        if not (valid & newest).any():
            return
        similar = float(np.median(found.zncc[valid & newest]))
        if np.isnan(self._first_zncc):
            self._first_zncc = similar
        lost = 1.0 - np.count_nonzero(valid & newest) / np.count_nonzero(newest)
        if similar < (1.0 - self._settings.zncc_fall) * self._first_zncc or lost > self._settings.lost_share:
            self._waited += 1
            if self._waited < _PATIENCE and self._is_blurred(current, found):
                return
            # what is much less alike than the rest is half covered: its old reference shows more of it
            self._begin(current, valid & (found.zncc >= similar - self._settings.zncc_fall))
        self._waited = 0

    def _is_blurred(self, current: PreparedImage, found: Tracked) -> bool:
        """Whether a frame shows the points less sharp than their reference: out of focus, or moving."""
        newest, valid = self._generations[self._newest], found.valid & (self._of == self._newest)
        places = (newest.position_px[valid], found.position_px[valid])
        before, now = (
            sharpness_per_px(image, place, self._settings.subset_px)
            for image, place in zip((newest.image, current), places, strict=True)
        )
        return now < _SHARP * before

    def _begin(self, image: PreparedImage, taken: BoolArray) -> None:
        """Make an image the reference of some points; the others keep theirs and may come back there.

        References that no point has any more are let go.
        """
        last, count = self._last, len(self._of)
        nan = np.full((count, self._parameters), np.nan)
        generation = _Generation(image, last.position_px.copy(), last.covariance_px2.copy(), last.gradient.copy())
        generation.shape, generation.before = nan, nan.copy()
        generation.shape[taken] = 0.0
        self._renewals += bool(self._generations)
        self._newest += 1
        self._of[taken] = self._newest
        self._generations[self._newest] = generation
        used = set(self._of.tolist())
        self._generations = {number: kept for number, kept in self._generations.items() if number in used}
