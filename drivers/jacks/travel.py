"""How long a jack travels."""

from __future__ import annotations

import math


def travel_s(distance: float, speed: float, acceleration: float) -> float:
    """Seconds from rest to rest over ``distance``, at ``speed`` at most, with constant acceleration and deceleration.

    A trapezoid of speed over time, or, where top speed is not reached, a triangle: d = a (t / 2)^2.
    """
    distance = abs(distance)
    if distance < speed**2 / acceleration:
        return 2.0 * math.sqrt(distance / acceleration)
    return distance / speed + speed / acceleration
