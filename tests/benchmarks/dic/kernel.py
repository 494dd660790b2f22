"""The kernel alone: one core, images filtered before, guesses that are the truth rounded to whole pixels."""

from __future__ import annotations

import statistics
import time

import numpy as np

from bscd.dic import prepare
from bscd.dic.library import InstructionSet, can_run
from bscd.dic.solver import SolverOptions, solve
from tests.benchmarks.dic.cases import NOISE_GREY, SUBSET_PX, TIMED, Bench

WANTED = {InstructionSet.AVX512: "100 000", InstructionSet.AVX2: "60 000", InstructionSet.BASELINE: "20 000"}
TITLES = {InstructionSet.AVX512: "AVX-512", InstructionSet.AVX2: "AVX2", InstructionSet.BASELINE: "without either"}

_ROUNDS = 7


def kernel_rate(bench: Bench, instructions: InstructionSet) -> float:
    """Points per second of processor time, quintic, affine; NaN where this machine can not run the instructions."""
    if not can_run(instructions):
        return float("nan")
    (pair,) = bench.exposures(TIMED, NOISE_GREY, 1)
    images = [prepare(image, subset_px=SUBSET_PX) for image in (pair.reference, pair.current)]
    points = bench.points[bench.requested(TIMED)].astype(np.float64)
    guesses = np.zeros((len(points), 6))
    guesses[:, [0, 3]] = np.rint(TIMED.motion.displacement_px(points))
    options = SolverOptions(subset_px=SUBSET_PX)
    took = []
    for _ in range(_ROUNDS):
        begun = time.process_time()
        solve(*images, points, guesses, options, threads=1, instructions=instructions)
        took.append(time.process_time() - begun)
    return len(points) / statistics.median(took)
