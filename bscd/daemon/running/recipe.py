"""Run any recipe: what the operator confirms first, what stands in the volume, then the work."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bscd.daemon.recipes import (
    Align,
    BscScan,
    Calibrate,
    Home,
    Inflation,
    Measure,
    Move,
    Recipe,
    ReferenceScan,
    SphereCheck,
)
from bscd.daemon.running.bench_work import run_align, run_home, run_inflation, run_move, run_scan, run_sphere
from bscd.daemon.running.desk_work import run_calibrate, run_measure
from bscd.daemon.running.work import Work

_RUNNERS: dict[type[Recipe], Callable[[Any, Work], None]] = {
    Home: run_home,
    Move: run_move,
    Align: run_align,
    ReferenceScan: run_scan,
    BscScan: run_scan,
    SphereCheck: run_sphere,
    Inflation: run_inflation,
    Calibrate: run_calibrate,
    Measure: run_measure,
}


def run_single(recipe: Recipe, work: Work) -> None:
    """Run a recipe that is no campaign."""
    for text in _asked(recipe, work):
        work.prompts.confirm(text, work.control)
    _RUNNERS[type(recipe)](recipe, work)


def step_name(job: str, step: str) -> str:
    """What a campaign's step calls what it makes."""
    return f"{job}-{step}"


def _asked(recipe: Recipe, work: Work) -> list[str]:
    texts = [recipe.prompt] if recipe.prompt else []
    if recipe.specimen is not None:
        placing = work.bench.place(recipe.specimen)
        texts += [placing] if placing else []
    return texts
