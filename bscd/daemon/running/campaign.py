"""A campaign's steps, one after the other; what is done is kept, so that it can go on where it ended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from bscd.daemon.recipes import Campaign
from bscd.daemon.running.recipe import run_single, step_name
from bscd.daemon.running.work import Work


@dataclass
class CampaignState:
    """How far it is: the next step, and by step's name what was made and found."""

    next_step: int = 0
    made: dict[str, dict[str, str]] = field(default_factory=dict)
    figures: dict[str, Any] = field(default_factory=dict)

    def outputs(self) -> dict[str, str]:
        """As a job's document has them: "step.kind" -> name."""
        return {f"{step}.{kind}": name for step, kinds in self.made.items() for kind, name in kinds.items()}

    @classmethod
    def of(cls, next_step: int | None, outputs: dict[str, str], figures: dict[str, Any]) -> CampaignState:
        """From a job's document."""
        made: dict[str, dict[str, str]] = {}
        for key, name in outputs.items():
            step, _, kind = key.rpartition(".")
            made.setdefault(step, {})[kind] = name
        return cls(next_step or 0, made, dict(figures))


def run_campaign(
    recipe: Campaign,
    job: str,
    state: CampaignState,
    work_of: Callable[[str, str], Work],
    keep: Callable[[CampaignState], None],
) -> None:
    """Run from ``state.next_step`` on; ``work_of(name, prefix)`` makes each step's work, ``keep`` is called after it.

    Raises what the step raises that ends it; that step is the next one then.
    """
    count = len(recipe.steps)
    for number in range(state.next_step, count):
        step = recipe.steps[number]
        work = work_of(step_name(job, step.name), f"step {number + 1} of {count}, {step.name}: ")
        work.earlier = state.made
        work.control.require_going(f"campaign: before step {number + 1} ({step.name})", number)
        try:
            run_single(step.do, work)
        finally:
            if work.outputs:
                state.made[step.name] = dict(work.outputs)
            if work.figures:
                state.figures[step.name] = dict(work.figures)
            keep(state)
        state.next_step = number + 1
        keep(state)
