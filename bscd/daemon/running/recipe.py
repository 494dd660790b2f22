"""Run any recipe: what the operator confirms first, what stands in the volume, then the work."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
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
from bscd.daemon.running.work import Work


def run_single(recipe: Recipe, work: Work) -> None:
    """Run a recipe that is no campaign."""
    for text in _asked(recipe, work):
        work.prompts.confirm(text, work.control)
    _runners()[type(recipe)](recipe, work)


@cache
def _runners() -> dict[type[Recipe], Callable[[Any, Work], None]]:
    """What does each recipe; with the measuring chain, which takes a second to load and is not needed to be ready."""
    from bscd.daemon.running import bench_work, desk_work

    return {
        Home: bench_work.run_home,
        Move: bench_work.run_move,
        Align: bench_work.run_align,
        ReferenceScan: bench_work.run_scan,
        BscScan: bench_work.run_scan,
        SphereCheck: bench_work.run_sphere,
        Inflation: bench_work.run_inflation,
        Calibrate: desk_work.run_calibrate,
        Measure: desk_work.run_measure,
    }


def step_name(job: str, step: str) -> str:
    """What a campaign's step calls what it makes."""
    return f"{job}-{step}"


def _asked(recipe: Recipe, work: Work) -> list[str]:
    texts = [recipe.prompt] if recipe.prompt else []
    if recipe.specimen is not None:
        placing = work.bench.place(recipe.specimen)
        texts += [placing] if placing else []
    return texts
