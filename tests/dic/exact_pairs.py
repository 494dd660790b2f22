"""Pairs of exact motion for the correlator's tests, and how far its answers are from the truth."""

from __future__ import annotations

from dataclasses import fields
from functools import cache

import numpy as np
from numpy.typing import NDArray

from bscd.dic import Correlation, grid_points
from tests.dic.motions import FloatArray, Motion, rotation, stretch, translation
from tests.dic.speckle_pairs import Speckle, digitise

SIZE = (200, 160)
NOISE = 2.0
MOTIONS: dict[str, Motion] = {
    "half a pixel": translation(0.5, 0.5),
    "translation": translation(3.37, -2.61),
    "stretch": stretch(0.02, SIZE),
    "rotation": rotation(3.0, SIZE),
}

#: Farther off than this is no measurement of the point at all.
GROSS_PX = 0.5


@cache
def speckle(size_px: tuple[int, int] = SIZE, seed: int = 4) -> Speckle:
    return Speckle(seed=seed, size_px=size_px)


@cache
def shown(motion: Motion, size_px: tuple[int, int] = SIZE) -> FloatArray:
    return speckle(size_px).image(motion)


def pair(
    motion: Motion, seed: int = 0, noise: tuple[float, float] = (NOISE, NOISE), size_px: tuple[int, int] = SIZE
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    rest, moved = shown(translation(0.0, 0.0), size_px), shown(motion, size_px)
    rng = np.random.default_rng(seed)
    return digitise(rest, noise[0], rng), digitise(moved, noise[1], rng)


def points(step_px: int = 7, margin_px: int = 0, size_px: tuple[int, int] = SIZE) -> FloatArray:
    return grid_points(size_px[::-1], step_px, margin_px=margin_px)


def off_px(found: Correlation, truth: FloatArray) -> FloatArray:
    """Distance ``(N,)`` from the truth; NaN where a point is not valid."""
    return np.hypot(*(found.displacement_px - truth).T)


def seen(places: FloatArray, motion: Motion, margin_px: float = 0.0, size_px: tuple[int, int] = SIZE) -> NDArray:
    """Points that the current image shows."""
    moved = places + motion.displacement_px(places)
    return ((moved >= margin_px) & (moved <= np.array(size_px) - 1 - margin_px)).all(axis=1)


def same(one: Correlation, other: Correlation) -> None:
    for field in fields(Correlation):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)


def ring() -> NDArray[np.bool_]:
    rows, columns = np.indices(SIZE[::-1])
    distance = np.hypot(columns - 100, rows - 80)
    return (distance > 30) & (distance < 70)
