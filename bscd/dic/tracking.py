"""Track points of one view through a sequence, from each frame's result to the next; the reference is renewed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import BoolArray, FloatArray
from bscd.dic.correlation import Correlation, Status
from bscd.dic.correlator import correlate
from bscd.dic.curvature import SECOND, Curvature, follow_curvature
from bscd.dic.generations import FIRST, Generation, let_go
from bscd.dic.images import PreparedImage
from bscd.dic.recovery import Jump, is_due, recovered, trial_points
from bscd.dic.sharpness import sharpness_per_px
from bscd.dic.solver import PARAMETERS, KnownSubsets, Lighting, ShapeName
from bscd.dic.tracker_state import REFERENCE, GenerationState, Tracked, TrackerState, at_rest
from bscd.dic.tracking_kernel import carry_on
from bscd.dic.trees import quick_tree

#: A frame in which no more than this share of the points is found tells nothing of where they have gone.
_HOPELESS = 0.05

#: Recovery is for more than this share of all points; fewer are found by their neighbours, or not at all.
_MANY = 0.05

#: A frame less sharp than this share of the reference's sharpness becomes no reference, unless it stays so for so many.
_SHARP = 0.87
_PATIENCE = 3


@dataclass(frozen=True)
class TrackingSettings:
    """How points are tracked.

    The shape function "curved" holds the second derivatives that the field itself has. The reference is renewed when
    the median ZNCC has fallen by ``zncc_fall`` of what the first frame reached, or when ``lost_share`` of the points
    that it had are without a match.
    """

    subset_px: int = 21
    shape: ShapeName = "curved"
    lighting: Lighting = "linear"
    zncc_min: float = 0.7
    zncc_fall: float = 0.1
    lost_share: float = 0.02
    noise_grey: float | tuple[float, float] | None = None
    threads: int | None = None


class Tracker:
    """Follows points ``(N, 2)`` of a reference image through frames that are given one after the other."""

    def __init__(self, reference: PreparedImage, points_px: FloatArray, settings: TrackingSettings) -> None:
        count = len(points_px)
        self._settings = settings
        self._parameters = PARAMETERS[settings.shape]
        self._points_px = np.array(points_px, np.float64).reshape(-1, 2)
        self._generations: dict[int, Generation] = {}
        self._newest = -1
        self._of = np.zeros(count, np.int64)
        self._lost_for = np.zeros(count, np.int64)
        self._renewals = 0
        self._first_zncc = float("nan")
        self._last = at_rest(self._points_px)
        self._previous, self._previous_number = reference, REFERENCE
        self._tracked = 0
        self._hopeless = False
        self._waited = 0
        self._jump = Jump(reference, reference)
        self._begin(reference, REFERENCE, np.ones(count, bool))

    @classmethod
    def resumed(cls, state: TrackerState, images: Mapping[int, PreparedImage], settings: TrackingSettings) -> Tracker:
        """A tracker that goes on where another was, with the same results; ``images`` by the state's numbers."""
        tracker = cls(images[state.previous], state.points_px, settings)
        tracker._generations = {}
        for number, kept in state.generations.items():
            generation = Generation(images[kept.image], kept.image, kept.reached, kept.alike, kept.noise_grey)
            generation.shape, generation.before = kept.shape.copy(), kept.before.copy()
            tracker._generations[number] = generation
        tracker._newest, tracker._of, tracker._renewals = state.newest, state.of.copy(), state.renewals
        tracker._lost_for = state.lost_for
        tracker._first_zncc, tracker._last = state.first_zncc, state.last
        tracker._previous_number, tracker._tracked = state.previous, state.tracked
        tracker._hopeless, tracker._waited = state.hopeless, state.waited
        return tracker

    def state(self) -> TrackerState:
        """All that the next frame's result depends on, but the images."""
        return TrackerState(
            points_px=self._points_px,
            tracked=self._tracked,
            generations={
                number: GenerationState(
                    kept.number, kept.reached, kept.alike, kept.noise_grey, kept.shape.copy(), kept.before.copy()
                )
                for number, kept in self._generations.items()
            },
            newest=self._newest,
            of=self._of.copy(),
            lost_for=self._lost_for,
            renewals=self._renewals,
            first_zncc=self._first_zncc,
            last=self._last,
            previous=self._previous_number,
            hopeless=self._hopeless,
            waited=self._waited,
        )

    @property
    def tracked(self) -> int:
        """How many frames it has followed."""
        return self._tracked

    def track(self, current: PreparedImage) -> Tracked:
        """The points in the next frame."""
        self._jump = Jump(self._previous, current)
        found = self._matched(current)
        self._last = replace(found, renewals=self._renewals)
        self._hopeless = bool(np.count_nonzero(found.valid) < _HOPELESS * len(self._of))
        if not self._hopeless:
            self._previous, self._previous_number = current, self._tracked
            self._lost_for = np.where(found.valid, 0, self._lost_for + 1)
            self._renew_where_needed(current, found)
        self._tracked += 1
        return self._last

    def _matched(self, current: PreparedImage) -> Tracked:
        count = len(self._of)
        nan = float("nan")
        positions, zncc = np.full((count, 2), nan), np.full(count, nan)
        covariance, reference, frame, gradient = np.full((4, count, 2, 2), nan)
        status = np.full(count, Status.NO_GUESS, np.int32)
        whole = Tracked(positions, covariance, reference, frame, gradient, zncc, status, self._renewals)
        for number, generation in self._generations.items():
            mine = np.flatnonzero(self._of == number)
            if len(mine):
                self._match_generation(generation, mine, current, whole)
        self._match_beside_neighbours(current, whole)
        return whole

    def _match_generation(
        self, generation: Generation, mine: NDArray[np.int64], current: PreparedImage, whole: Tracked
    ) -> None:
        start = generation.reached.position_px[mine]
        guess = self._predicted(generation, mine)
        due = self._hopeless | is_due(self._lost_for[mine])
        guess[~due] = np.nan
        if self._hopeless:  # a few will do to tell whether the surface is back
            guess[np.setdiff1d(np.arange(len(mine)), trial_points(start, self._settings.subset_px))] = np.nan
        result = self._correlate(generation, mine, current, guess)
        if np.count_nonzero(~result.valid & due) > max(0.3 * len(mine), _MANY * len(self._of), 20):
            result = self._recovered(generation, mine, current, result)
        generation.before[mine] = generation.shape[mine]
        if self._settings.shape != "curved":
            self._take(generation, mine, result, whole)
            return
        result, second = follow_curvature(
            generation.image,
            current,
            start,
            result,
            self._curvature(generation, mine),
            self._subsets(generation).only(mine),
            **self._common(generation, current),
        )
        self._take(generation, mine, result, whole)
        generation.shape[np.ix_(mine[result.valid], SECOND)] = second[result.valid]

    def _match_beside_neighbours(self, current: PreparedImage, whole: Tracked) -> None:
        """Try the points without a match where the nearest ones with a match, of any reference, say that they are."""
        lost = np.flatnonzero(~whole.valid)
        if not len(lost) or not whole.valid.any():
            return
        known = np.flatnonzero(whole.valid)
        beside = known[quick_tree(self._points_px[known]).query(self._points_px[lost])[1]]
        deformation = np.eye(2) + whole.gradient[beside]
        offset = self._points_px[lost] - self._points_px[beside]
        place = whole.position_px[beside] + np.einsum("nij,nj->ni", deformation, offset)
        for number, generation in self._generations.items():
            here = self._of[lost] == number
            if not here.any():
                continue
            mine = lost[here]
            gradient = deformation[here] @ np.linalg.inv(np.eye(2) + generation.reached.gradient[mine]) - np.eye(2)
            moved = place[here] - generation.reached.position_px[mine]
            guess = np.column_stack([moved[:, 0], gradient[:, 0], moved[:, 1], gradient[:, 1]])
            result = self._correlate(generation, mine, current, guess)
            self._take(generation, mine, result, whole)

    def _take(self, generation: Generation, mine: NDArray[np.int64], result: Correlation, whole: Tracked) -> None:
        """Enter a generation's matches into the whole.

        The noise of the image in which the reference was renewed drew the points there aside, and the match that
        begins there draws them back, as far as both look at the same subset.
        """
        reached = generation.reached
        known = result.valid
        generation.shape[mine[known]] = result.shape[known]
        before, now = result.noise_grey
        carry_on(
            mine,
            result.gradient,
            result.covariance_px2,
            before**2 / max(before**2 + now**2, 1e-12),
            generation.alike,
            generation is self._generations.get(FIRST),
            reached.gradient,
            reached.covariance_px2,
            reached.reference_px2,
            reached.frame_px2,
            whole.covariance_px2,
            whole.reference_px2,
            whole.frame_px2,
            whole.gradient,
        )
        whole.position_px[mine] = reached.position_px[mine] + result.displacement_px
        whole.zncc[mine] = result.zncc
        whole.status[mine] = result.status

    def _correlate(
        self, generation: Generation, mine: NDArray[np.int64], current: PreparedImage, guess: FloatArray
    ) -> Correlation:
        return correlate(
            generation.image,
            current,
            generation.reached.position_px[mine],
            guess_px=guess,
            find_guesses=False,
            shape=self._settings.shape,
            known_subsets=self._subsets(generation).only(mine),
            **self._common(generation, current),
        )

    def _common(self, generation: Generation, current: PreparedImage) -> dict[str, Any]:
        settings = self._settings
        return {
            "subset_px": settings.subset_px,
            "lighting": settings.lighting,
            "interpolation": current.spline,
            "noise_grey": generation.noise_grey,
            "zncc_min": settings.zncc_min,
            "threads": settings.threads,
        }

    def _subsets(self, generation: Generation) -> KnownSubsets:
        if generation.subsets is None:
            generation.subsets = KnownSubsets.none_of(len(self._of), self._settings.shape)
        return generation.subsets

    def _curvature(self, generation: Generation, mine: NDArray[np.int64]) -> Curvature:
        if generation.curvature is None or not np.array_equal(generation.curvature[0], mine):
            generation.curvature = mine, Curvature(generation.reached.position_px[mine], self._settings.subset_px)
        return generation.curvature[1]

    def _predicted(self, generation: Generation, mine: NDArray[np.int64]) -> FloatArray:
        """Shape parameters of steady motion: the last ones and once more their last change.

        Of second derivatives half of it: the other half is noise.
        """
        last, before = generation.shape[mine], generation.before[mine]
        ahead = 2.0 * last - before
        if self._settings.shape == "curved":
            ahead[:, SECOND] = 1.5 * last[:, SECOND] - before[:, SECOND] / 2.0
        return np.where(np.isfinite(ahead), ahead, last)

    def _recovered(
        self, generation: Generation, mine: NDArray[np.int64], current: PreparedImage, first: Correlation
    ) -> Correlation:
        start = generation.reached.position_px[mine]

        def attempt(index: NDArray[np.int64], guess: FloatArray) -> Correlation:
            return self._correlate(generation, mine[index], current, guess)

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
            self._begin(current, self._tracked, valid & (found.zncc >= similar - self._settings.zncc_fall))
        self._waited = 0

    def _is_blurred(self, current: PreparedImage, found: Tracked) -> bool:
        """Whether a frame shows the points less sharp than their reference: out of focus, or moving."""
        newest, valid = self._generations[self._newest], found.valid & (self._of == self._newest)
        places = (newest.reached.position_px[valid], found.position_px[valid])
        before, now = (
            sharpness_per_px(image, place, self._settings.subset_px)
            for image, place in zip((newest.image, current), places, strict=True)
        )
        return now < _SHARP * before

    def _alike(self, which: BoolArray) -> FloatArray:
        """Share ``(n,)`` that a subset of this frame has in common with one that followed the surface here."""
        before = np.zeros((len(self._of), 2, 2))
        for number, generation in self._generations.items():
            here = self._of == number
            before[here] = generation.reached.gradient[here]
        leg = (np.eye(2) + self._last.gradient[which]) @ np.linalg.inv(np.eye(2) + before[which])
        stretch = np.linalg.svd(leg, compute_uv=False)
        return np.prod(np.minimum(stretch, 1.0 / stretch), axis=1)

    def _begin(self, image: PreparedImage, number: int, taken: BoolArray) -> None:
        """Make an image the reference of some points; the others keep theirs, or the first, and may come back there."""
        count, noise = len(self._of), self._settings.noise_grey
        nan = np.full((count, self._parameters), np.nan)
        alike = np.zeros(count)
        if self._generations:
            noise = noise if noise is None or isinstance(noise, (int, float)) else (noise[1], noise[1])
            alike[taken] = self._alike(taken)
        generation = Generation(image, number, self._last, alike, noise)
        generation.shape, generation.before = nan, nan.copy()
        generation.shape[taken] = 0.0
        self._renewals += bool(self._generations)
        self._newest += 1
        self._of[taken] = self._newest
        self._generations[self._newest] = generation
        self._generations, self._of = let_go(self._generations, self._of, self._last.valid)
