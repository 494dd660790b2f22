"""The pairs that correlators are measured on, and which points they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tests.dic.cramer_rao import cramer_rao_px
from tests.dic.motions import FloatArray, Motion, rotation, sinusoid, stretch, translation
from tests.dic.speckle_pairs import SIZE_PX, Speckle, digitise

STEP_PX, SUBSET_PX = 5, 21
NOISE_GREY = 2.0


@dataclass(frozen=True)
class Case:
    """A motion, and whether an affine subset follows it exactly, so that only noise is left to err."""

    name: str
    motion: Motion
    affine: bool = True
    largest_px: float = 5.0


TENTHS = [tenth / 10.0 for tenth in range(11)]
ALONG_COLUMNS = [Case(f"translation ({t}, 0)", translation(t, 0.0)) for t in TENTHS]
ALONG_ROWS = [Case(f"translation (0, {t})", translation(0.0, t)) for t in TENTHS[1:]]
OTHERS = [
    Case("translation (3.37, -2.61)", translation(3.37, -2.61)),
    Case("stretch 2 %", stretch(0.02, SIZE_PX), largest_px=13.0),
    Case("rotation 3 degrees", rotation(3.0, SIZE_PX), largest_px=43.0),
    Case("sinusoid, period 256", sinusoid(1.0, 256.0), affine=False),
    Case("sinusoid, period 64", sinusoid(0.5, 64.0), affine=False),
]
TIMED = OTHERS[0]


@dataclass(frozen=True)
class Exposure:
    """A pair as a camera would give it."""

    reference: NDArray[np.uint8]
    current: NDArray[np.uint8]


class Bench:
    """One speckle pattern, its grid of points and its limit, kept; current images are made one after another."""

    def __init__(self) -> None:
        self.speckle = Speckle()
        self.points = grid_px(SIZE_PX)

    def requested(self, case: Case) -> NDArray[np.bool_]:
        """Which of the grid's points are requested: see `requested`."""
        return requested(self.points, case.motion.displacement_px, SIZE_PX)

    def exposures(self, case: Case, noise_grey: float, seeds: int) -> Iterator[Exposure]:
        """Pairs of one motion; noise differs from seed to seed, from case to case and between the two images."""
        still, moved = self._still, self.speckle.image(case.motion)
        for seed in range(seeds):
            rng = np.random.default_rng([seed, *case.name.encode()])
            yield Exposure(digitise(still, noise_grey, rng), digitise(moved, noise_grey, rng))

    @cached_property
    def limit_px(self) -> FloatArray:
        """Cramer-Rao limit of an affine match at each point of the grid, for `NOISE_GREY` in both images."""
        return cramer_rao_px(self._still, self.speckle.gradient(), self.points, (NOISE_GREY, NOISE_GREY), SUBSET_PX)

    @cached_property
    def _still(self) -> FloatArray:
        return self.speckle.image()


def grid_px(size_px: tuple[int, int], step_px: int = STEP_PX, subset_px: int = SUBSET_PX) -> NDArray[np.int64]:
    """Points ``(N, 2)`` at the step, from the first whose subset lies inside the image to the last."""
    half = subset_px // 2
    lines = [np.arange(half, length - half, step_px) for length in size_px]
    return np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)


def requested(
    points_px: NDArray[np.int64],
    displacement_px: Callable[[FloatArray], FloatArray],
    size_px: tuple[int, int],
    subset_px: int = SUBSET_PX,
) -> NDArray[np.bool_]:
    """Points inside the image: all pixels of the subset lie in the reference, and where they truly go in the current.

    Every figure is over all of these. ``displacement_px`` maps reference points to displacements; the subset's
    corners and the middles of its sides stand for its outline.
    """
    half = subset_px // 2
    inside = np.ones(len(points_px), dtype=bool)
    for offset in np.stack(np.meshgrid([-half, 0, half], [-half, 0, half]), axis=-1).reshape(-1, 2):
        pixel = (points_px + offset).astype(np.float64)
        for place in (pixel, pixel + displacement_px(pixel)):
            inside &= (place >= 0.0).all(axis=1) & (place <= np.subtract(size_px, 1)).all(axis=1)
    return inside
