"""Pairs of speckle images with exact truth: both are sampled from the same formula, neither from the other.

The pattern is soft spots of paint, ``I = dark + (bright - dark) (1 - prod_k (1 - a_k exp(-d_k^2 / r_k^2)))``, where
d is the distance from the spot in the reference image. A current image shows the same material moved:
``I_current(x) = I_reference(material_px(x))``, with the motion's inverse in closed form or by Newton. So the truth
at a reference point is the motion's displacement there, without any interpolation. Pixels sample at their centres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tests.dic.motions import FloatArray, Motion, translation
from tests.dic.speckle_kernel import REACH, paint, paint_gradient

SIZE_PX = (1280, 1024)

_MARGIN_PX = 120
_RADII = (0.8, 1.2)
_HEIGHTS = (0.6, 1.0)


@dataclass(frozen=True)
class Speckle:
    """A random pattern; ``size_px`` is (columns, rows), the spots also fill a margin that motions bring in."""

    seed: int = 1
    size_px: tuple[int, int] = SIZE_PX
    radius_px: float = 2.6
    spots_per_px2: float = 0.026
    dark_grey: float = 25.0
    bright_grey: float = 230.0

    @cached_property
    def spots(self) -> FloatArray:
        """``(N, 4)``: column, row, radius in px, height."""
        rng = np.random.default_rng(self.seed)
        columns, rows = self.size_px
        count = int(self.spots_per_px2 * (columns + 2 * _MARGIN_PX) * (rows + 2 * _MARGIN_PX))
        x = rng.uniform(-_MARGIN_PX, columns + _MARGIN_PX, count)
        y = rng.uniform(-_MARGIN_PX, rows + _MARGIN_PX, count)
        return np.column_stack([x, y, self.radius_px * rng.uniform(*_RADII, count), rng.uniform(*_HEIGHTS, count)])

    def image(self, motion: Motion | None = None) -> FloatArray:
        """The grey levels ``(rows, columns)`` without noise or rounding, of the reference if nothing moves."""
        moved = motion or translation(0.0, 0.0)
        columns, rows = self.size_px
        across = np.arange(columns, dtype=np.float64)[None, :]
        down = np.arange(rows, dtype=np.float64)[:, None]
        x, y = np.broadcast_arrays(*moved.material_px(across, down))
        bare = paint(np.ascontiguousarray(x), np.ascontiguousarray(y), *self._reached(moved))
        return self.dark_grey + (self.bright_grey - self.dark_grey) * (1.0 - bare)

    def gradient(self) -> FloatArray:
        """Exact derivatives by column and row ``(2, rows, columns)`` of the reference image, grey levels per px."""
        columns, rows = self.size_px
        slope = paint_gradient(rows, columns, *self._reached(translation(0.0, 0.0)))
        return (self.dark_grey - self.bright_grey) * slope

    def pair(self, motion: Motion, noise_grey: float = 0.0, seed: int = 0) -> tuple[NDArray[np.uint8], ...]:
        """Reference and current image with 8 bits and Gaussian noise, which is independent in the two."""
        reference_noise, current_noise = (np.random.default_rng([seed, which]) for which in (0, 1))
        return (
            digitise(self.image(), noise_grey, reference_noise),
            digitise(self.image(motion), noise_grey, current_noise),
        )

    def _reached(self, motion: Motion) -> tuple[FloatArray, NDArray[np.int64]]:
        """The spots that the image shows, and the pixels that each reaches."""
        centres = self.spots[:, :2] + motion.displacement_px(self.spots[:, :2])
        reach = (REACH * self.spots[:, 2] * _growth(motion, self.spots[:, :2]))[:, None]
        low = np.clip(np.ceil(centres - reach), 0, self.size_px).astype(np.int64)
        high = np.clip(np.floor(centres + reach) + 1, 0, self.size_px).astype(np.int64)
        seen = (low < high).all(axis=1)
        boxes = np.column_stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]])
        return self.spots[seen], boxes[seen]


def digitise(image: FloatArray, noise_grey: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Noise, rounding and the limits of an 8-bit camera."""
    noisy = image + rng.normal(0.0, noise_grey, image.shape) if noise_grey > 0.0 else image
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _growth(motion: Motion, points_px: FloatArray) -> float:
    """How much wider a spot may become: the largest stretch of short steps along and across, and 2 % more."""
    longest = 0.0
    for step in (np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.array([0.7, 0.7]), np.array([0.7, -0.7])):
        moved = step + motion.displacement_px(points_px + step) - motion.displacement_px(points_px)
        longest = max(longest, float(np.hypot(*moved.T).max() / np.hypot(*step)))
    return 1.02 * longest
