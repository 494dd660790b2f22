"""The correlator beside its peers, on pairs with exact truth and on DIC Challenge sample 14, as a table.

``scripts/bench dic`` takes a quarter of an hour, most of it the peers'; ``python -m tests.benchmarks.bench_dic
--quick`` a few minutes with fewer motions and seeds, ``--no-peers`` leaves the peers out. Peers see one seed a motion.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isnan
from typing import TypeVar

from tests.benchmarks.dic.accuracy import Score, coverage, largest_bias_px, over_limit, rms_px, score
from tests.benchmarks.dic.cases import ALONG_COLUMNS, ALONG_ROWS, NOISE_GREY, OTHERS, Bench, Case
from tests.benchmarks.dic.kernel import TITLES, WANTED, kernel_rate
from tests.benchmarks.dic.libraries import OURS, Library, libraries
from tests.benchmarks.dic.sample14 import LEVELS, Sample14
from tests.benchmarks.dic.speed import Speed, speeds
from tests.benchmarks.peers.process import Worker, WorkerError

THREADS = 2
Measured = TypeVar("Measured")
SAMPLE_14_OPTIONS: dict[str, str | float] = {"shape": "translation", "zncc_min": 0.6}
"""What our correlator is asked for on sample 14 beside its defaults: its strains stay below 0.7 %, its palest subsets
are no more alike than 0.67 for their noise."""


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    along_columns: list[Case]
    along_rows: list[Case]
    seeds: int
    rounds: int
    levels: tuple[str, ...]


FULL = Effort(ALONG_COLUMNS, ALONG_ROWS, seeds=5, rounds=5, levels=LEVELS)
QUICK = Effort(ALONG_COLUMNS[::3], [], seeds=2, rounds=3, levels=("L5",))


@dataclass
class Table:
    """Rows of quantity, wanted and a cell for each library; a cell that was not measured is a dash."""

    titles: dict[str, str]
    rows: list[tuple[str, str, dict[str, str]]] = field(default_factory=list)

    def add(self, quantity: str, wanted: str, cells: dict[str, str]) -> None:
        self.rows.append((quantity, wanted, cells))

    def __str__(self) -> str:
        lines = [["quantity", *self.titles.values(), "wanted"], ["---"] * (len(self.titles) + 2)]
        lines += [
            [quantity, *(cells.get(n, "-") for n in self.titles), wanted] for quantity, wanted, cells in self.rows
        ]
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    """Measure and print."""
    said = argparse.ArgumentParser(description=__doc__)
    said.add_argument("--quick", action="store_true", help="fewer motions, seeds and rounds")
    said.add_argument("--no-peers", action="store_true", help="ours alone")
    said.add_argument("--no-ours", action="store_true", help="the peers alone")
    options = said.parse_args()
    effort = QUICK if options.quick else FULL
    found, remarks = libraries(peers=not options.no_peers, ours=not options.no_ours)
    bench, table = Bench(), Table({library.name: library.title for library in found})
    add_speed(table, bench, found, effort)
    remarks += add_accuracy(table, bench, found, effort)
    remarks += add_sample14(table, found, effort)
    print(table)
    for remark in [*remarks, f"load of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"]:
        print(f"\n{remark}")


def add_speed(table: Table, bench: Bench, found: list[Library], effort: Effort) -> None:
    """Rows of the whole job's speed, the kernel's and the memory."""
    measured = {threads: speeds(bench, found, threads, effort.rounds) for threads in (1, THREADS)}
    wanted = {1: "65 000 with AVX-512", 2: "100 000 with AVX-512"}
    for threads, by_name in measured.items():
        name = f"whole job at step 5, {threads} thread{'s' * (threads > 1)}, points/s"
        table.add(name, wanted[threads], cells(by_name, lambda s: f"{round(s.points_per_s, -2):.0f}"))
        table.add("ours over it, median of the rounds", "6 x pyvale", cells(by_name, _times))
    if any(library.name == OURS for library in found):
        for instructions, limit in WANTED.items():
            rate = kernel_rate(bench, instructions)
            said = "not on this machine" if isnan(rate) else f"{round(rate, -2):.0f}"
            table.add(f"kernel alone, a core, {TITLES[instructions]}, points/s", limit, {OURS: said})
    most = {name: max(run[name].peak_mb for run in measured.values() if name in run) for name in table.titles}
    table.add("memory, largest resident, MB", "600", cells(most, lambda mb: f"{mb:.0f}"))


def add_accuracy(table: Table, bench: Bench, found: list[Library], effort: Effort) -> list[str]:
    """Rows of bias, noise, calibration and losses; returns what failed."""
    quiet: dict[str, list[Score]] = {}
    noisy: dict[str, list[Score]] = {}
    others: dict[str, list[Score]] = {}
    quadratic: dict[str, list[Score]] = {}
    remarks = []
    for library in found:
        ours = library.name == OURS
        motions = effort.along_columns + (effort.along_rows if ours else [])
        try:
            with library.start(THREADS) as worker:
                seeds = effort.seeds if ours else 1
                quiet[library.name] = scores(worker, bench, motions, 0.0, 1)
                noisy[library.name] = scores(worker, bench, motions, NOISE_GREY, seeds)
                others[library.name] = scores(worker, bench, OTHERS, NOISE_GREY, 1)
                if ours:
                    bent = [case for case in OTHERS if not case.affine]
                    quadratic[library.name] = scores(worker, bench, bent, NOISE_GREY, 1, {"shape": "quadratic"})
        except WorkerError as err:
            remarks.append(str(err))
    still = {name: [s for s in run if s.case.affine] for name, run in others.items()}
    exact = {name: noisy[name] + still[name] for name in still}
    every = {name: quiet[name] + noisy[name] + others[name] + quadratic.get(name, []) for name in still}
    table.add("largest bias, translations, noise 0, px", "0.0001", cells(quiet, lambda r: f"{largest_bias_px(r):.5f}"))
    table.add("the same, noise 2", "0.0003", cells(noisy, lambda r: f"{largest_bias_px(r):.5f}"))
    table.add("std over the Cramer-Rao limit, noise 2", "1.05", cells(noisy, lambda r: f"{over_limit(r):.3f}"))
    table.add("errors within the reported sigma, %", "63 to 73", cells(exact, _share))
    table.add("lost points, all cases", "0.1 %", cells(every, _lost))
    table.add("gross errors (> 0.5 px), all cases", "0", cells(every, lambda r: str(sum(s.gross for s in r))))
    for which, case in enumerate(OTHERS):
        table.add(f"rms error, {case.name}, px", "", cells(others, lambda r, i=which: f"{rms_px(r[i]):.4f}"))
    for which, bent in enumerate([case for case in OTHERS if not case.affine]):
        name = f"the same, quadratic subsets, {bent.name}"
        table.add(name, "", cells(quadratic, lambda r, i=which: f"{rms_px(r[i]):.4f}"))
    return remarks


def add_sample14(table: Table, found: list[Library], effort: Effort) -> list[str]:
    """A row for each level: rms of u, and how many of the requested points were found."""
    sample = Sample14.find()
    if sample is None:
        return ["no folder of real images (BSCD_DATA), so sample 14 is left out"]
    measured: dict[str, dict[str, str]] = {level: {} for level in effort.levels}
    remarks = []
    for library in found:
        options = SAMPLE_14_OPTIONS if library.name == OURS else {}
        try:
            with library.start(THREADS) as worker:
                for level in effort.levels:
                    got = sample.measure(worker, level, options)
                    measured[level][library.name] = f"{got.rms_u_px:.4f} ({got.points} of {got.requested})"
        except WorkerError as err:
            remarks.append(str(err))
    for level in effort.levels:
        table.add(f"sample 14 {level}, rms of u, px (points)", "0.021", measured[level])
    remarks.append(f"Cramer-Rao limit of an affine match on sample 14: {sample.limit_px():.4f} px, all points")
    return remarks


def scores(
    worker: Worker,
    bench: Bench,
    cases: list[Case],
    noise_grey: float,
    seeds: int,
    options: Mapping[str, str] | None = None,
) -> list[Score]:
    return [score(worker, bench, case, noise_grey, seeds, options) for case in cases]


def cells(measured: Mapping[str, Measured], shown: Callable[[Measured], str]) -> dict[str, str]:
    """A cell for each library that was measured."""
    return {name: shown(value) for name, value in measured.items()}


def _times(speed: Speed) -> str:
    return "-" if isnan(speed.ours_over) else f"{speed.ours_over:.1f}"


def _share(run: list[Score]) -> str:
    share = coverage(run)
    return "-" if isnan(share) else f"{100 * share:.1f}"


def _lost(run: list[Score]) -> str:
    lost, asked = sum(s.lost for s in run), sum(s.requested for s in run)
    return f"{lost} of {asked} ({100 * lost / asked:.3f} %)"


if __name__ == "__main__":
    sys.exit(main())
