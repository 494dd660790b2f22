"""Motions known in closed form, both ways: where a material point goes, and which one is seen at a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_NEWTON_STEPS = 20
_NEWTON_CLOSE_PX = 1e-13


class Motion(Protocol):
    """A motion of the reference image's material."""

    def displacement_px(self, points_px: FloatArray) -> FloatArray:
        """Displacement ``(N, 2)`` of the material at ``points_px (N, 2)`` of the reference image."""
        ...

    def material_px(self, columns_px: FloatArray, rows_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Column and row in the reference image of the material seen at these pixels of the current image.

        The two arrays may broadcast against each other, such as ``(1, W)`` and ``(H, 1)`` for a whole image.
        """
        ...


@dataclass(frozen=True)
class Affine:
    """``x = centre + matrix (X - centre) + shift``."""

    matrix: tuple[tuple[float, float], tuple[float, float]] = ((1.0, 0.0), (0.0, 1.0))
    shift_px: tuple[float, float] = (0.0, 0.0)
    centre_px: tuple[float, float] = (0.0, 0.0)

    def displacement_px(self, points_px: FloatArray) -> FloatArray:
        change = np.array(self.matrix) - np.eye(2)
        return (points_px - self.centre_px) @ change.T + self.shift_px

    def material_px(self, columns_px: FloatArray, rows_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        inverse = np.linalg.inv(self.matrix)
        across = columns_px - self.centre_px[0] - self.shift_px[0]
        down = rows_px - self.centre_px[1] - self.shift_px[1]
        return (
            self.centre_px[0] + inverse[0, 0] * across + inverse[0, 1] * down,
            self.centre_px[1] + inverse[1, 0] * across + inverse[1, 1] * down,
        )


@dataclass(frozen=True)
class Sinusoid:
    """``u = A sin(kX) cos(kY / 2)``, ``v = A cos(kY)`` with ``k = 2 pi / period``."""

    amplitude_px: float
    period_px: float

    @property
    def _per_px(self) -> float:
        return 2.0 * np.pi / self.period_px

    def displacement_px(self, points_px: FloatArray) -> FloatArray:
        angle = self._per_px * points_px
        across = np.sin(angle[:, 0]) * np.cos(angle[:, 1] / 2.0)
        return self.amplitude_px * np.column_stack([across, np.cos(angle[:, 1])])

    def material_px(self, columns_px: FloatArray, rows_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        # v depends on Y alone, so each coordinate is the root of one equation: t + a trig(k t) = seen
        k, amplitude = self._per_px, self.amplitude_px
        quarter = np.pi / 2.0
        rows = _solve(np.asarray(rows_px, dtype=np.float64), amplitude, k, quarter)
        columns = _solve(np.asarray(columns_px, dtype=np.float64), amplitude * np.cos(k * rows / 2.0), k, 0.0)
        return columns, rows


@dataclass(frozen=True)
class Bend:
    """``u = a (X - c)^2 / 2``, ``v = -a (X - c)^2 / 4``: second derivatives that are the same everywhere."""

    second_per_px: float
    column_px: float

    def displacement_px(self, points_px: FloatArray) -> FloatArray:
        along = self.second_per_px * (points_px[:, 0] - self.column_px) ** 2
        return np.column_stack([along / 2.0, -along / 4.0])

    def material_px(self, columns_px: FloatArray, rows_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        a = self.second_per_px
        off = 2.0 * (columns_px - self.column_px) / (1.0 + np.sqrt(1.0 + 2.0 * a * (columns_px - self.column_px)))
        return self.column_px + off, rows_px + a * off**2 / 4.0


def _solve(seen: FloatArray, amplitude: FloatArray | float, k: float, phase: float) -> FloatArray:
    """Root of ``t + amplitude sin(k t + phase) = seen`` by Newton; unique while ``amplitude k < 1``."""
    root = seen - amplitude * np.sin(k * seen + phase)
    for _ in range(_NEWTON_STEPS):
        angle = k * root + phase
        step = (root + amplitude * np.sin(angle) - seen) / (1.0 + amplitude * k * np.cos(angle))
        root = root - step
        if np.abs(step).max() < _NEWTON_CLOSE_PX * max(1.0, np.abs(seen).max()):
            return root
    raise ArithmeticError(f"no inverse of a sinusoid of amplitude times k {np.max(np.abs(amplitude)) * k:.3g}")


def centre_of(size_px: tuple[int, int]) -> tuple[float, float]:
    """Centre of an image of so many columns and rows."""
    return (size_px[0] - 1) / 2.0, (size_px[1] - 1) / 2.0


def translation(across_px: float, down_px: float) -> Affine:
    return Affine(shift_px=(across_px, down_px))


def stretch(strain: float, size_px: tuple[int, int]) -> Affine:
    """Uniaxial along the columns, contracting across so that the area grows as the root of the stretch."""
    factor = 1.0 + strain
    return Affine(((factor, 0.0), (0.0, factor**-0.5)), centre_px=centre_of(size_px))


def rotation(angle_deg: float, size_px: tuple[int, int]) -> Affine:
    """About the centre, from the columns' axis towards the rows' axis."""
    cos, sin = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return Affine(((cos, -sin), (sin, cos)), centre_px=centre_of(size_px))


def sinusoid(amplitude_px: float, period_px: float) -> Sinusoid:
    return Sinusoid(amplitude_px, period_px)


def bend(second_per_px: float, size_px: tuple[int, int]) -> Bend:
    return Bend(second_per_px, centre_of(size_px)[0])
