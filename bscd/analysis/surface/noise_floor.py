"""Noise floors of displacement and strain from frames of an object that does not move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.arrays import BoolArray, FloatArray
from bscd.errors import InputError

_ROUNDS = 200
_SETTLED = 1e-12


@dataclass(frozen=True)
class NoiseFloor:
    """Noise of C components of a field at rest, all in the unit of the field; NaN where too little is known.

    ``std`` ``(C,)``: standard deviation over time about each point's mean and the frame's drift, pooled over points.
    ``spatial_std`` ``(C,)``: standard deviation over the points of a frame about the frame's mean, pooled over frames;
    it holds the reference's noise and fixed patterns too, and is what the iDICs guide (2018) asks to be reported for
    displacement and strain. ``bias`` ``(C,)``: mean over points and frames. ``drift`` ``(T, C)``: a frame's common
    departure from the points' means; they sum to 0 over the frames. ``point_std`` ``(N, C)``: the temporal standard
    deviation point by point, for maps. ``frames`` and ``points`` count those that have at least one value.
    """

    std: FloatArray
    spatial_std: FloatArray
    bias: FloatArray
    drift: FloatArray
    point_std: FloatArray
    frames: int
    points: int


def noise_floor(field: FloatArray) -> NoiseFloor:
    """The noise floor of a field ``(T, N, C)`` measured T times at rest: displacements in mm, or strains.

    NaN is left out, each value by itself. Two-way analysis of variance: value = point's mean + frame's drift + noise,
    solved by alternate means (exact at once when nothing is missing); degrees of freedom are values - points - frames
    + 1. Positions may be given too; their ``bias`` and ``spatial_std`` then say nothing.

    Raises
    ------
    InputError
        Not three axes, or fewer than two frames or points with values.
    """
    field = np.asarray(field, dtype=np.float64)
    if field.ndim != 3:
        raise InputError(f"a noise floor needs a field (T, N, C), not an array of shape {field.shape}")
    known = np.isfinite(field)
    frames = int(known.any(axis=(1, 2)).sum())
    points = int(known.any(axis=(0, 2)).sum())
    if frames < 2 or points < 2:
        raise InputError(f"a noise floor needs two frames and two points or more; {frames} and {points} have values")
    values = np.where(known, field, 0.0)
    means, drift = _two_way(values, known)
    residual = np.where(known, values - means - drift[:, None], 0.0)
    freedom = known.sum(axis=(0, 1)) - known.any(axis=0).sum(axis=0) - known.any(axis=1).sum(axis=0) + 1
    std = np.sqrt(_over(np.sum(residual**2, axis=(0, 1)), freedom))
    repeats = known.sum(axis=0)
    point_std = np.sqrt(_over(np.sum(residual**2, axis=0), repeats - 1))
    in_frame = np.where(known, values - _over(values.sum(axis=1), known.sum(axis=1))[:, None], 0.0)
    spatial_freedom = known.sum(axis=(0, 1)) - known.any(axis=1).sum(axis=0)
    spatial = np.sqrt(_over(np.sum(in_frame**2, axis=(0, 1)), spatial_freedom))
    bias = _over(values.sum(axis=(0, 1)), known.sum(axis=(0, 1)))
    shown = np.where(known.any(axis=1), drift, np.nan)
    return NoiseFloor(std, spatial, bias, shown, point_std, frames, points)


def _two_way(values: FloatArray, known: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Points' means ``(N, C)`` and frames' drifts ``(T, C)`` of least squares; drifts sum to 0."""
    drift = np.zeros((values.shape[0], values.shape[2]))
    seen = known.any(axis=1)
    means = np.zeros(values.shape[1:])
    for _ in range(_ROUNDS):
        means = np.nan_to_num(_over(np.sum(np.where(known, values - drift[:, None], 0.0), axis=0), known.sum(axis=0)))
        renewed = np.nan_to_num(_over(np.sum(np.where(known, values - means, 0.0), axis=1), known.sum(axis=1)))
        middle = _over(renewed.sum(axis=0), seen.sum(axis=0))
        renewed = np.where(seen, renewed - middle, 0.0)
        step, drift = np.abs(renewed - drift).max(), renewed
        if step <= _SETTLED * max(float(np.abs(values).max()), 1e-300):
            break
    means = np.nan_to_num(_over(np.sum(np.where(known, values - drift[:, None], 0.0), axis=0), known.sum(axis=0)))
    return means, drift


def _over(total: FloatArray, count) -> FloatArray:
    """Quotients, NaN where nothing is counted."""
    count = np.asarray(count)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
