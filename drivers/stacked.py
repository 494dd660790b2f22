"""How a height is split between two jacks, one on top of the other."""

from __future__ import annotations

from drivers.interfaces import Range


def split_height(
    height_mm: float, limits_mm: tuple[Range, Range], lower_share: float, resolution_mm: float
) -> tuple[float, float]:
    """Heights of the lower and the upper jack, mm, whose sum is ``height_mm``.

    The lower jack takes ``lower_share`` (0..1) of what exceeds both lowest heights, in whole steps of
    ``resolution_mm``; where one jack's range ends the other takes the rest. ``height_mm`` must lie in the sum
    of both ranges (`limits_mm`, lower jack first).
    """
    lower, upper = limits_mm
    wanted = lower.low + lower_share * (height_mm - lower.low - upper.low)
    least = max(lower.low, height_mm - upper.high)
    most = min(lower.high, height_mm - upper.low)
    stepped = round(round(wanted / resolution_mm) * resolution_mm, 9)
    taken = min(max(stepped, least), most)
    return taken, height_mm - taken
