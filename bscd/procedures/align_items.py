"""Alignment as numbers: what was measured, how far it may be off, and what to turn."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AlignmentItem:
    """One figure of the alignment: good while ``abs(value - ideal) <= limit``.

    ``advice`` is a sentence: what to turn and how far; empty when the figure is good.
    """

    name: str
    value: float
    unit: str
    limit: float
    ideal: float = 0.0
    advice: str = ""
    note: str = ""
    """What to know about how the value was found; empty where there is nothing."""

    @property
    def ok(self) -> bool:
        """Whether the figure is within its limit; NaN is not."""
        return abs(self.value - self.ideal) <= self.limit


@dataclass(frozen=True)
class AlignmentReport:
    """The figures of one alignment, in the order in which to put them right."""

    items: tuple[AlignmentItem, ...]

    @property
    def ok(self) -> bool:
        """Whether every figure is within its limit."""
        return all(item.ok for item in self.items)

    def __getitem__(self, name: str) -> AlignmentItem:
        """The figure of that name."""
        return next(item for item in self.items if item.name == name)


def item(
    name: str,
    value: float,
    unit: str,
    limit: float,
    *,
    ideal: float = 0.0,
    low: str,
    high: str,
    note: str = "",
) -> AlignmentItem:
    """An item with the advice for a value that is too ``low`` or too ``high``, taken only when it is off."""
    found = AlignmentItem(name, value, unit, limit, ideal, note=note)
    if found.ok:
        return found
    advice = high if value > ideal else low
    return AlignmentItem(name, value, unit, limit, ideal, advice, note)
