"""Points per second and memory of the whole job: two images and a grid in, displacements out."""

from __future__ import annotations

import statistics
import sys
from contextlib import ExitStack
from dataclasses import dataclass

from tests.benchmarks.dic.cases import NOISE_GREY, TIMED, Bench
from tests.benchmarks.dic.libraries import OURS, Library
from tests.benchmarks.peers.process import WorkerError


@dataclass(frozen=True)
class Speed:
    """Medians over the rounds; ``ours_over`` is the median of the rounds' own ratios, NaN for ours or without ours."""

    points_per_s: float
    ours_over: float
    peak_mb: float


def speeds(bench: Bench, found: list[Library], threads: int, rounds: int) -> dict[str, Speed]:
    """Each library's speed; in a round all run one after another, so that they share the machine's moods."""
    (pair,) = bench.exposures(TIMED, NOISE_GREY, 1)
    seconds: dict[str, list[float]] = {}
    peaks: dict[str, float] = {}
    with ExitStack() as stack:
        running = [stack.enter_context(library.start(threads)) for library in found]
        for _ in range(rounds):
            for worker in list(running):
                try:
                    took = worker.correlate(pair.reference, pair.current, bench.points)
                except WorkerError as err:
                    print(f"bench: {err}", file=sys.stderr, flush=True)
                    running.remove(worker)
                    continue
                seconds.setdefault(worker.library, []).append(took.seconds)
                peaks[worker.library] = took.peak_mb
                print(f"bench: {worker.library}, {threads} threads, {took.seconds:.2f} s", file=sys.stderr, flush=True)
    return {
        name: Speed(
            points_per_s=len(bench.points) / statistics.median(times),
            ours_over=_ratio(times, seconds.get(OURS, [])) if name != OURS else float("nan"),
            peak_mb=peaks[name],
        )
        for name, times in seconds.items()
    }


def _ratio(theirs: list[float], ours: list[float]) -> float:
    ratios = [their / our for their, our in zip(theirs, ours, strict=False)]
    return statistics.median(ratios) if ratios else float("nan")
