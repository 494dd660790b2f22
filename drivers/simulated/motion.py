"""Motion of one motor: constant acceleration, constant speed, constant deceleration; pure functions of time.

Lengths are in the axis's unit (mm or deg). A move too short to reach top speed is a triangle: it accelerates to
the middle and decelerates from there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Motion:
    """From ``start`` to ``end`` in phases of constant acceleration, at rest afterwards.

    ``velocity`` is that at the start (unit/s), ``phases`` are pairs (duration s, acceleration unit/s^2).
    """

    start: float
    end: float
    velocity: float = 0.0
    phases: tuple[tuple[float, float], ...] = ()


def at_rest(position: float) -> Motion:
    """No motion at all."""
    return Motion(position, position)


def trapezoidal(start: float, end: float, speed: float, acceleration: float) -> Motion:
    """The fastest motion from rest to rest within ``speed`` (unit/s) and ``acceleration`` (unit/s^2)."""
    distance = abs(end - start)
    if distance == 0.0:
        return at_rest(end)
    signed = math.copysign(acceleration, end - start)
    ramp_s = speed / acceleration
    if distance < speed * ramp_s:
        half_s = math.sqrt(distance / acceleration)
        return Motion(start, end, 0.0, ((half_s, signed), (half_s, -signed)))
    return Motion(start, end, 0.0, ((ramp_s, signed), (max(0.0, distance / speed - ramp_s), 0.0), (ramp_s, -signed)))


def braking(motion: Motion, time_s: float, acceleration: float) -> Motion:
    """The motion that follows when ``motion`` is stopped ``time_s`` after its start."""
    position = position_at(motion, time_s)
    velocity = velocity_at(motion, time_s)
    if velocity == 0.0:
        return at_rest(position)
    brake_s = abs(velocity) / acceleration
    return Motion(
        position, position + velocity * brake_s / 2.0, velocity, ((brake_s, -math.copysign(acceleration, velocity)),)
    )


def duration_s(motion: Motion) -> float:
    """Seconds from start to rest."""
    return math.fsum(phase_s for phase_s, _ in motion.phases)


def position_at(motion: Motion, time_s: float) -> float:
    """Position ``time_s`` after the start; before it the start, after the last phase exactly the end."""
    if time_s <= 0.0:
        return motion.start
    if time_s >= duration_s(motion):
        return motion.end
    position, velocity = motion.start, motion.velocity
    for phase_s, acceleration in motion.phases:
        part_s = min(phase_s, time_s)
        position += velocity * part_s + acceleration * part_s**2 / 2.0
        velocity += acceleration * part_s
        time_s -= part_s
        if time_s <= 0.0:
            break
    return position


def velocity_at(motion: Motion, time_s: float) -> float:
    """Velocity ``time_s`` after the start, unit/s; 0 before the start and from the end on."""
    if time_s < 0.0 or time_s >= duration_s(motion):
        return 0.0
    velocity = motion.velocity
    for phase_s, acceleration in motion.phases:
        part_s = min(phase_s, time_s)
        velocity += acceleration * part_s
        time_s -= part_s
        if time_s <= 0.0:
            break
    return velocity
