"""A table of a report, as rows of text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Column heads and rows of text; ``marked`` are the rows to stress, ``name`` is its anchor."""

    name: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    marked: Sequence[int] = ()
