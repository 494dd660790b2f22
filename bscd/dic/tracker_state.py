"""What a tracker knows between two frames, without the images: small, and another process can go on from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import BoolArray, FloatArray
from bscd.dic.correlation import Status

#: The number of the first reference among a tracker's images; frames count from 0.
REFERENCE = -1


@dataclass(frozen=True, eq=False)
class Tracked:
    """Where N points are in a frame.

    ``position_px`` ``(N, 2)``; ``covariance_px2`` ``(N, 2, 2)`` of it, all matches since the first reference
    together, ``reference_px2`` and ``frame_px2`` ``(N, 2, 2)`` the parts of it that are the noise of the first
    reference and of the frame itself; ``gradient`` ``(N, 2, 2)`` of the displacement since the first reference by the
    position there; ``zncc`` ``(N,)`` against the reference of the moment; ``status`` ``(N,)``; ``renewals`` how often
    it was renewed before. NaN where a point is not valid.
    """

    position_px: FloatArray
    covariance_px2: FloatArray
    reference_px2: FloatArray
    frame_px2: FloatArray
    gradient: FloatArray
    zncc: FloatArray
    status: NDArray[np.int32]
    renewals: int

    @property
    def valid(self) -> BoolArray:
        """Which points were found, ``(N,)``."""
        return self.status == Status.VALID


def at_rest(points_px: FloatArray) -> Tracked:
    """Points ``(N, 2)`` in their reference."""
    none = np.zeros((len(points_px), 2, 2))
    status = np.full(len(points_px), Status.VALID, np.int32)
    return Tracked(points_px, none, none, none, none, np.ones(len(points_px)), status, 0)


@dataclass(frozen=True, eq=False)
class GenerationState:
    """A reference: the number of its image, what the points had come to there, and how they moved since.

    ``alike`` ``(N,)``, ``shape`` and ``before`` ``(N, 6 or 12)``: as the tracker keeps them.
    """

    image: int
    reached: Tracked
    alike: FloatArray
    noise_grey: float | tuple[float, float] | None
    shape: FloatArray
    before: FloatArray


@dataclass(frozen=True, eq=False)
class TrackerState:
    """A tracker after ``tracked`` frames; nothing in it changes, and it can be pickled.

    ``generations`` by their number, in the order of matching; ``of`` ``(N,)`` says which one a point has, ``lost_for``
    ``(N,)`` in how many frames it was not found; ``previous`` is the number of the last image that showed the points.
    ``images`` are the numbers of all images that going on needs: `REFERENCE`, and frames from 0.
    """

    points_px: FloatArray
    tracked: int
    generations: dict[int, GenerationState]
    newest: int
    of: NDArray[np.int64]
    lost_for: NDArray[np.int64]
    renewals: int
    first_zncc: float
    last: Tracked
    previous: int
    hopeless: bool
    waited: int

    @property
    def images(self) -> frozenset[int]:
        """Numbers of the images that going on needs."""
        return frozenset({self.previous, *(generation.image for generation in self.generations.values())})
