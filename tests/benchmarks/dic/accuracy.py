"""Errors over all requested points of the pairs with exact truth."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.dic.cases import Bench, Case
from tests.benchmarks.peers.process import Worker

GROSS_PX = 0.5


@dataclass(frozen=True)
class Score:
    """One library on one motion at one noise, all seeds together; errors are measured minus true, (u, v).

    ``bias_px`` is the mean over seeds, points and nothing else; ``std_px`` what varies about each seed's mean;
    ``limit_px`` the Cramer-Rao limit (root mean square over the same points); ``within`` how many of the errors lie
    within the standard deviation that the library reports, NaN where it reports none.
    """

    case: Case
    requested: int
    lost: int
    gross: int
    bias_px: NDArray[np.float64]
    std_px: NDArray[np.float64]
    rms_px: NDArray[np.float64]
    limit_px: NDArray[np.float64]
    within: float


def score(
    worker: Worker, bench: Bench, case: Case, noise_grey: float, seeds: int, options: Mapping[str, str] | None = None
) -> Score:
    """Correlate every seed of a motion. Invalid points are lost; all valid ones count in the errors."""
    asked = bench.requested(case)
    truth = case.motion.displacement_px(bench.points[asked].astype(np.float64))
    errors, within = [], []
    for pair in bench.exposures(case, noise_grey, seeds):
        found = worker.correlate(
            pair.reference, pair.current, bench.points, largest_px=case.largest_px, options=options
        )
        valid = found.valid[asked]
        errors.append(found.displacement_px[asked][valid] - truth[valid])
        if found.sigma_px is not None:
            within.append(np.abs(errors[-1]) <= found.sigma_px[asked][valid])
        print(f"bench: {worker.library}, {case.name}, noise {noise_grey:g}", file=sys.stderr, flush=True)
    every = np.concatenate(errors)
    return Score(
        case,
        requested=seeds * int(asked.sum()),
        lost=seeds * int(asked.sum()) - len(every),
        gross=int((np.hypot(*every.T) > GROSS_PX).sum()),
        bias_px=np.mean([seed.mean(axis=0) for seed in errors], axis=0),
        std_px=np.sqrt(np.mean([seed.var(axis=0) for seed in errors], axis=0)),
        rms_px=np.sqrt(np.mean(every**2, axis=0)),
        limit_px=np.sqrt(np.mean(bench.limit_px[asked] ** 2, axis=0)),
        within=float(np.concatenate(within).mean()) if within else float("nan"),
    )


def largest_bias_px(scores: Iterable[Score]) -> float:
    return float(max(np.abs(s.bias_px).max() for s in scores))


def over_limit(scores: Iterable[Score]) -> float:
    """Standard deviation over its limit, both pooled over motions and over u and v."""
    pooled = [(np.mean(s.std_px**2), np.mean(s.limit_px**2)) for s in scores]
    measured, limit = np.mean(pooled, axis=0)
    return float(np.sqrt(measured / limit))


def coverage(scores: Iterable[Score]) -> float:
    """Share of errors within one reported standard deviation, all motions alike."""
    return float(np.mean([s.within for s in scores]))


def rms_px(score: Score) -> float:
    """Root mean square error of u and v together."""
    return float(np.sqrt(np.mean(score.rms_px**2)))
