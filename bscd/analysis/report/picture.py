"""A figure of a report with its words."""

from __future__ import annotations

from dataclasses import dataclass

from matplotlib.figure import Figure


@dataclass(frozen=True)
class Picture:
    """A figure, its name (of the file too), its title and its explanation."""

    name: str
    title: str
    explanation: str
    figure: Figure
