"""DIC Challenge sample 14: real speckle moved numerically, by a truth that depends on the column alone.

The reference and three images in which the columns move by a sinusoid of 0.1 px that becomes denser to the right
(L1 < L3 < L5), no row moves, and every image has its own noise of 3.5 grey levels. ``Sample14Exact.mat``: column 0
the pixel column, columns 1, 3 and 5 the u of L1, L3 and L5, in the file's counting from 0. The figure is the root mean
square of u minus the exact u of the point's column, over all grid points of all rows at step 5 whose subset lies
inside. Of an affine match that is the noise: its Cramer-Rao limit is 0.022 px, and 0.021 px 40 px from the borders.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.ndimage import correlate1d

from tests.benchmarks.dic.accuracy import GROSS_PX
from tests.benchmarks.dic.cases import grid_px, requested
from tests.benchmarks.peers.process import Worker
from tests.dic.cramer_rao import cramer_rao_px

LEVELS = ("L1", "L3", "L5")
_AT_REST_COLUMNS = 95
_CENTRAL = np.array([-1 / 60, 3 / 20, -3 / 4, 0, 3 / 4, -3 / 20, 1 / 60])


@dataclass(frozen=True)
class Level:
    """One of the three: errors of u and of v (truth 0), over the valid ones of the requested points."""

    requested: int
    points: int
    gross: int
    rms_u_px: float
    rms_v_px: float


class Sample14:
    """The images and their truth, read once."""

    def __init__(self, folder: Path) -> None:
        self.images = {
            name: _grey(folder / file)
            for name, file in [
                ("reference", "Sample14 Reference.tif"),
                *((level, f"Sample14 {level} Amp0.1b.tif") for level in LEVELS),
            ]
        }
        exact = loadmat(folder / "Sample14Exact.mat")["Sample14Exact"]
        self.exact_px = {level: exact[:, 1 + 2 * which] for which, level in enumerate(LEVELS)}
        rows, columns = self.images["reference"].shape
        self.size_px = (columns, rows)
        self.points = grid_px(self.size_px)

    @classmethod
    def find(cls) -> Sample14 | None:
        """From the folder of real images, or nothing where that is absent."""
        root = Path(__file__).resolve().parents[3]
        folder = Path(os.environ.get("BSCD_DATA", root.parent / "shared/data")) / "dic-challenge-14"
        return cls(folder) if folder.is_dir() else None

    def measure(self, worker: Worker, level: str, options: Mapping[str, str | float] | None = None) -> Level:
        found = worker.correlate(self.images["reference"], self.images[level], self.points, options=options)
        asked = requested(self.points, lambda points: self._truth(points, level), self.size_px)
        good = asked & found.valid
        error = found.displacement_px[good] - self._truth(self.points[good], level)
        print(f"bench: {worker.library}, sample 14 {level}", file=sys.stderr, flush=True)
        rms = np.sqrt(np.mean(error**2, axis=0))
        return Level(
            requested=int(asked.sum()),
            points=int(good.sum()),
            gross=int((np.hypot(*error.T) > GROSS_PX).sum()),
            rms_u_px=float(rms[0]),
            rms_v_px=float(rms[1]),
        )

    def limit_px(self) -> float:
        """Cramer-Rao limit of u for affine matches, root mean square over the grid.

        The noise is that of the columns that do not move; the gradient is the reference's own by differences, with its
        noise, so the limit is good to a few per cent.
        """
        reference = self.images["reference"].astype(np.float64)
        differences = [self.images[level] - reference for level in LEVELS]
        noise = np.std([difference[:, :_AT_REST_COLUMNS] for difference in differences]) / np.sqrt(2.0)
        gradient = np.stack([correlate1d(reference, _CENTRAL, axis=axis) for axis in (1, 0)])
        limit = cramer_rao_px(reference, gradient, self.points, (noise, noise))
        return float(np.sqrt(np.mean(limit[:, 0] ** 2)))

    def _truth(self, points: NDArray[np.integer] | NDArray[np.float64], level: str) -> NDArray[np.float64]:
        across = np.interp(points[:, 0], np.arange(self.size_px[0]), self.exact_px[level])
        return np.column_stack([across, np.zeros(len(points))])


def _grey(path: Path) -> NDArray[np.uint8]:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise FileNotFoundError(f"{path} can not be read as an image")
    return image.astype(np.uint8)
