"""The order in which points get their initial guesses, and what is done with those that fail."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.dic.confirmation import confirmed
from bscd.dic.correlation import GuessSource, Status
from bscd.dic.guess import (
    DenseFlow,
    FeatureMatches,
    extrapolate,
    guess_by_search,
    nearest_known,
    seed_points,
)
from bscd.dic.images import PreparedImage
from bscd.dic.library import FOUND_COLUMNS
from bscd.dic.solver import PARAMETERS, KnownSubsets, Solved, SolverOptions, solve
from bscd.dic.trees import quick_tree

#: A point that ended up this far from what its neighbour let expect is looked at again.
_SURPRISE_PX = 0.5

#: How far from its points a match's displacement and gradients are taken on, in subsets.
_REACH_SUBSETS = 4.0

#: Matches that differ by more than this many times the noise may be chance; those more similar than this are sure
#: enough to judge others, but a pattern of few shapes is that similar to itself elsewhere.
_CHANCE_NOISES = 2.0
_CHANCE_ZNCC = 0.99
_CHANCE_ROUNDS = 5

#: Matches whose subsets are smaller than this in the current image, as a share of their area, are none.
_LEAST_AREA = 0.2

_ROUNDS = 200
_NEIGHBOURS = 4

#: Features are looked for when more points than this lack a match; so many points at most are searched for.
_FEW = 20
_SEARCHES = 3000

#: No other guess can help these.
_FINAL = (Status.VALID, Status.LOW_TEXTURE)


class Matching:
    """One correlation under way: the results so far and where each guess came from."""

    def __init__(
        self,
        reference: PreparedImage,
        current: PreparedImage,
        points_px: FloatArray,
        options: SolverOptions,
        search_px: int,
        threads: int | None,
        known_subsets: KnownSubsets | None = None,
    ) -> None:
        count = len(points_px)
        self._images = (reference, current)
        self._points = points_px
        self._options = options
        self._search_px = search_px
        self._threads = threads
        self._known_subsets = known_subsets
        self._parameters = PARAMETERS[options.shape]
        self.solved = Solved(
            np.full((count, self._parameters), np.nan),
            np.full((count, len(FOUND_COLUMNS)), np.nan),
            np.full(count, Status.NO_GUESS, np.int32),
            np.zeros(count, np.int32),
        )
        self.guess = np.full(count, GuessSource.NONE, np.int8)
        self._surprising = np.zeros(count, bool)
        self._last_tree: tuple[IntArray, KDTree] | None = None
        self._looked = False
        self._hopeless = ~self._on_reference()
        self.solved.status[self._hopeless] = Status.OUTSIDE

    def run(self, given: FloatArray | None, find: bool = True) -> None:
        """Try the guesses in the order of their cost, each only for the points that are still without a match.

        Without ``find`` only the given ones and what propagates from them.
        """
        if not len(self._points):
            return
        if given is not None:
            self._attempt(np.arange(len(given)), given, GuessSource.GIVEN)
            self._spread()
        if find and self._open().any():
            self._attempt_with(DenseFlow(*self._images), GuessSource.FLOW)
        if find and np.count_nonzero(self._open()) > _FEW:
            self._attempt_with(FeatureMatches(*self._images), GuessSource.FEATURES)
        if find and self._open().any():
            self._search()
        self._settle()

    def _attempt_with(self, finder: DenseFlow | FeatureMatches, source: GuessSource) -> None:
        """Try what a finder says at seeds, and what they find at their neighbours; then wherever that did not reach."""
        index = np.flatnonzero(self._open())
        seeds = index[seed_points(self._points[index], self._options.subset_px)]
        self._attempt(seeds, self._widened(finder.at(self._points[seeds])), source)
        self._challenge(np.flatnonzero(self.solved.valid))
        self._spread()
        left = np.flatnonzero(self._open())
        if len(left):
            self._attempt(left, self._widened(finder.at(self._points[left])), source)
            self._spread()

    def _attempt(self, index: IntArray, guesses: FloatArray, source: GuessSource) -> None:
        """Solve points ``(n,)`` from their guesses ``(n, P)`` and keep what is better than before."""
        usable = ~self._hopeless[index] & np.isfinite(guesses).all(axis=1)
        if usable.any():
            self._keep(index[usable], self._solve(index[usable], guesses[usable]), source)

    def _solve(self, index: IntArray, guesses: FloatArray) -> Solved:
        known = None if self._known_subsets is None else self._known_subsets.only(index)
        points, threads = self._points[index], self._threads
        tried = solve(*self._images, points, guesses, self._options, threads=threads, known_subsets=known)
        half = self._parameters // 2
        valid = np.flatnonzero(tried.valid)
        (ux, uy), (vx, vy) = tried.shape[valid, 1:3].T, tried.shape[valid, half + 1 : half + 3].T
        # a few pixels are like anything: subsets that shrank to them, or that turned over, are none
        tried.status[valid[(1.0 + ux) * (1.0 + vy) - uy * vx < _LEAST_AREA]] = Status.DIVERGED
        return tried

    def _keep(self, index: IntArray, tried: Solved, source: GuessSource) -> None:
        before, now = self.solved.column("zncc")[index], tried.column("zncc")
        was, is_ = self.solved.valid[index], tried.valid
        better = np.where(was, is_ & (now > before + 1e-6), True)
        kept = index[better]
        self._looked &= not len(kept)
        self.solved.shape[kept], self.solved.found[kept] = tried.shape[better], tried.found[better]
        self.solved.status[kept], self.solved.iterations[kept] = tried.status[better], tried.iterations[better]
        self.guess[kept] = source

    def _spread(self) -> None:
        """Propagate the matches that were found, but none by chance."""
        self._refuse_chance()
        self._propagate()
        self._refuse_chance()

    def _propagate(self) -> None:
        """From matched points to their neighbours, wave after wave, the most reliable neighbour first."""
        tried = np.full(len(self._points), -1, np.int64)
        reach = _REACH_SUBSETS * self._options.subset_px
        for _ in range(_ROUNDS):
            waiting, known = np.flatnonzero(self._open()), np.flatnonzero(self.solved.valid)
            if not len(waiting) or not len(known):
                return
            first = len(waiting) > len(self._points) // 2
            best, distance = nearest_known(
                self._points[waiting],
                self._tree(known),
                self.solved.column("zncc")[known],
                1 if first else _NEIGHBOURS,
            )
            new = (tried[waiting] != known[best]) & (distance < reach)
            waiting, source = waiting[new], known[best[new]]
            if not len(waiting):
                return
            tried[waiting] = source
            self._from_neighbours(waiting, source)

    def _from_neighbours(self, index: IntArray, source: IntArray) -> None:
        guesses = extrapolate(self.solved.shape[source], self._points[index] - self._points[source])
        tried = self._solve(index, guesses)
        half = self._parameters // 2
        moved = np.hypot(tried.shape[:, 0] - guesses[:, 0], tried.shape[:, half] - guesses[:, half])
        self._surprising[index[tried.valid & (moved > _SURPRISE_PX)]] = True
        self._keep(index, tried, GuessSource.PROPAGATED)

    def _settle(self) -> None:
        """What surprised or may be chance is challenged once more, now that its neighbours are known."""
        surprising = np.flatnonzero((self._surprising | self._doubtful()) & self.solved.valid)
        if len(surprising):
            self._challenge(surprising)
        self._refuse_chance()

    def _refuse_chance(self) -> None:
        """Refuse matches that differ by far more than noise and that no field of neighbours confirms.

        Once all are confirmed they stay so until one is changed.
        """
        if self._looked:
            return
        unlike, doubtful, zncc = self._unlike(), self._doubtful(), self.solved.column("zncc")
        if not (unlike & self.solved.valid).any():
            return
        tried = np.flatnonzero(~self._hopeless & (self.solved.status != Status.NO_GUESS))
        points, shape = self._points[tried], self.solved.shape[tried]
        for _ in range(_CHANCE_ROUNDS):
            valid = self.solved.valid[tried]
            index = np.flatnonzero(valid & unlike[tried])
            sure = valid & ~doubtful[tried]
            alone = index[~confirmed(index, points, shape, valid, sure, zncc[tried], self._options.subset_px)]
            if not len(alone):
                self._looked = True
                return
            self.solved.status[tried[alone]] = Status.LOW_ZNCC
            self.guess[self._led_outside()] = GuessSource.NONE  # perhaps by these

    def _unlike(self) -> BoolArray:
        """Matches that leave more than the noise."""
        residual, gain = (self.solved.column(name) for name in ("residual_variance", "gain"))
        noise = self._options.noise_grey**2 + (self._options.noise_both_grey**2 - self._options.noise_grey**2) / gain**2
        return residual > _CHANCE_NOISES**2 * noise

    def _doubtful(self) -> BoolArray:
        """Matches that leave more than the noise and are not that similar."""
        return self._unlike() & (self.solved.column("zncc") < _CHANCE_ZNCC)

    def _challenge(self, index: IntArray) -> None:
        """Compare points with what the median of their neighbours lets expect; where it differs the better match stays.

        A point that no neighbour confirms and that is much less similar than they are is refused.
        """
        known = np.flatnonzero(self.solved.valid)
        if len(known) <= _NEIGHBOURS or not len(index):
            return
        expected, similar = self._expected(index, known)
        half = self._parameters // 2
        off = np.hypot(*(self.solved.shape[index][:, [0, half]] - expected[:, [0, half]]).T)
        contradicted = off > _SURPRISE_PX
        index, expected, similar = index[contradicted], expected[contradicted], similar[contradicted]
        if not len(index):
            return
        self._keep(index, self._solve(index, expected), GuessSource.PROPAGATED)
        off = np.hypot(*(self.solved.shape[index][:, [0, half]] - expected[:, [0, half]]).T)
        doubtful = (off > 2.0) & (self.solved.column("zncc")[index] < similar - 0.2)
        self._looked &= not doubtful.any()
        self.solved.status[index[doubtful]] = Status.LOW_ZNCC

    def _expected(self, index: IntArray, known: IntArray) -> tuple[FloatArray, FloatArray]:
        """Median over the nearest known points of the shape ``(n, P)`` they let expect at points, and of their ZNCC."""
        _, near = self._tree(known).query(self._points[index], k=_NEIGHBOURS + 1)
        source = known[near]
        others = source != index[:, None]
        offsets = self._points[index][:, None] - self._points[source]
        shapes = extrapolate(self.solved.shape[source].reshape(-1, self._parameters), offsets.reshape(-1, 2)).reshape(
            *source.shape, -1
        )
        shapes[~others] = np.nan
        return np.nanmedian(shapes, axis=1), np.median(self.solved.column("zncc")[source], axis=1)

    def _tree(self, known: IntArray) -> KDTree:
        """Of known points, ``known`` their numbers; made once while they are the same."""
        if self._last_tree is None or not np.array_equal(self._last_tree[0], known):
            self._last_tree = known, quick_tree(self._points[known])
        return self._last_tree[1]

    def _search(self) -> None:
        """Search windows about the nearest match, or about no displacement, at the points that are left."""
        index = np.flatnonzero(self._open())
        seeds = seed_points(self._points[index], self._options.subset_px)
        index = index[seeds[:: max(1, len(seeds) // _SEARCHES)]] if len(index) > _SEARCHES else index
        about = np.zeros((len(index), 2))
        known = np.flatnonzero(self.solved.valid)
        if len(known):
            best, _ = nearest_known(self._points[index], self._tree(known), self.solved.column("zncc")[known])
            source = known[best]
            moved = extrapolate(self.solved.shape[source], self._points[index] - self._points[source])
            about = moved[:, [0, self._parameters // 2]]
        found = guess_by_search(*self._images, self._points[index], about, self._options.subset_px, self._search_px)
        self._attempt(index, self._widened(found), GuessSource.SEARCH)
        self._spread()

    def _open(self) -> BoolArray:
        """Points without a match that another guess might still give one."""
        # a comparison that could not be ended: it is the current image that is blank where the guess was
        lured = (self.solved.status == Status.LOW_TEXTURE) & np.isnan(self.solved.column("pixels"))
        lured &= self.solved.iterations > 0
        settled = (np.isin(self.solved.status, _FINAL) & ~lured) | self._hopeless
        return ~settled & ~self._led_outside()

    def _led_outside(self) -> BoolArray:
        """Points that have left the current image, as their neighbours say."""
        return (self.solved.status == Status.OUTSIDE) & (self.guess == GuessSource.PROPAGATED)

    def _widened(self, affine: FloatArray) -> FloatArray:
        """Affine guesses ``(N, 6)`` as parameters of the shape function."""
        if self._options.shape == "translation":
            return affine * np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0])
        if self._parameters == affine.shape[1]:
            return affine
        whole = np.zeros((len(affine), self._parameters))
        half = self._parameters // 2
        whole[:, :3], whole[:, half : half + 3] = affine[:, :3], affine[:, 3:]
        return whole

    def _on_reference(self) -> BoolArray:
        """Points ``(N,)`` that lie on the reference image and on no masked pixel."""
        height, width = self._images[0].shape
        column, row = self._points.T
        on = (column >= 0) & (row >= 0) & (column <= width - 1) & (row <= height - 1)
        mask = self._images[0].mask
        if mask is not None:
            nearest = np.floor(self._points[on] + 0.5).astype(np.int64)
            on[on] = mask[nearest[:, 1], nearest[:, 0]] != 0
        return on
