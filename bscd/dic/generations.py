"""The references that a tracker keeps: the first, the newest and a few between, however often one is renewed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.dic.curvature import Curvature
from bscd.dic.images import PreparedImage
from bscd.dic.recovery import after
from bscd.dic.solver import KnownSubsets
from bscd.dic.tracker_state import Tracked

#: References that are kept; each takes its image, and memory for every point.
MOST_KEPT = 5

#: The first reference; every point was seen there.
FIRST = 0


@dataclass
class Generation:
    """A reference image and what the points had come to there; rows for all points, NaN for those not in it."""

    image: PreparedImage
    number: int
    """Of the image: `REFERENCE`, or the frame's."""
    reached: Tracked
    alike: FloatArray
    """What a point's subset here has in common with the one that was matched to it, a share ``(N,)``."""
    noise_grey: float | tuple[float, float] | None
    shape: FloatArray = field(init=False)
    """The last known shape parameters from here, ``(N, 6 or 12)``; NaN where there are none."""
    before: FloatArray = field(init=False)
    curvature: tuple[NDArray[np.int64], Curvature] | None = None
    """Of the points that have this reference, and which they were."""
    subsets: KnownSubsets | None = None
    """What the kernel found of the points' subsets here."""


def let_go(
    generations: dict[int, Generation], of: NDArray[np.int64], valid: BoolArray
) -> tuple[dict[int, Generation], NDArray[np.int64]]:
    """The references to keep, and which one each point has then, of ``of`` ``(N,)``.

    The first and the newest stay, and of the others those that points have, at most `MOST_KEPT` in all: those that
    show the most of the points that are ``valid`` ``(N,)``, then the later ones. Points of a reference that is let go
    return to the first, and are looked for there where they were seen last.
    """
    newest = max(generations)
    others = [number for number in generations if number not in (FIRST, newest) and (of == number).any()]
    others.sort(key=lambda number: (np.count_nonzero(valid & (of == number)), number))
    dropped = others[: max(len(others) - (MOST_KEPT - 2), 0)]
    of = of.copy()
    for number in dropped:
        rows = np.flatnonzero(of == number)
        _send_back(generations[FIRST], generations[number], rows)
        of[rows] = FIRST
    kept = {FIRST, newest, *others} - set(dropped)
    return {number: each for number, each in generations.items() if number in kept}, of


def _send_back(first: Generation, later: Generation, rows: IntArray) -> None:
    """Have some points go on from the first reference; it has the affine part of how they moved since."""
    half = later.shape.shape[1] // 2
    affine = [0, 1, 2, half, half + 1, half + 2]
    moved = later.reached.position_px[rows] - first.reached.position_px[rows]
    gradient = later.reached.gradient[rows]
    led_there = np.column_stack([moved[:, 0], gradient[:, 0], moved[:, 1], gradient[:, 1]])
    first.shape[rows] = 0.0
    first.shape[np.ix_(rows, affine)] = after(led_there, later.shape[np.ix_(rows, affine)])
    first.before[rows] = np.nan
