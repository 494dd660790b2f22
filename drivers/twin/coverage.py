"""Shares of a pixel: a disc's in closed form, and the lattice of points for those that an edge crosses."""

from __future__ import annotations

import math

from numba import njit

#: Points of the Fibonacci lattice over a pixel that an edge crosses, and the step between them. Its points have as
#: many different columns as rows, so that edges along the pixel's sides are as finely resolved as oblique ones.
LATTICE, LATTICE_STEP = 144, 89


@njit(cache=True)
def lattice_point(k):
    """Point ``k`` of the lattice, from -1/2 to 1/2 in column and row."""
    return (k + 0.5) / LATTICE - 0.5, ((k * LATTICE_STEP) % LATTICE + 0.5) / LATTICE - 0.5


@njit(cache=True)
def _wedge(ax, ay, bx, by, radius):
    """Signed area that the disc about the origin shares with the triangle (origin, a, b).

    The segment a-b is cut where it crosses the circle; inside, the piece is a triangle, outside a sector.
    """
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    if length2 == 0.0:
        return 0.0
    middle = -(ax * dx + ay * dy) / length2
    gap = radius * radius - (ax * ax + ay * ay) + middle * middle * length2
    enter, leave = 1.0, 1.0
    if gap > 0.0:
        half = math.sqrt(gap / length2)
        enter, leave = min(max(middle - half, 0.0), 1.0), min(max(middle + half, 0.0), 1.0)
    px, py = ax + enter * dx, ay + enter * dy
    qx, qy = ax + leave * dx, ay + leave * dy
    area = 0.5 * (px * qy - py * qx)
    sector = math.atan2(ax * py - ay * px, ax * px + ay * py) + math.atan2(qx * by - qy * bx, qx * bx + qy * by)
    return area + 0.5 * radius * radius * sector


@njit(cache=True)
def disc_share(us, vs, centre_u, centre_v, radius):
    """Share 0..1 of the quadrilateral with corners ``us``, ``vs`` (4 each, in order) inside a disc.

    Green's theorem edge by edge: exact for straight edges.
    """
    u0, v0, u1, v1 = us[0] - centre_u, vs[0] - centre_v, us[1] - centre_u, vs[1] - centre_v
    u2, v2, u3, v3 = us[2] - centre_u, vs[2] - centre_v, us[3] - centre_u, vs[3] - centre_v
    near = min(min(u0 * u0 + v0 * v0, u1 * u1 + v1 * v1), min(u2 * u2 + v2 * v2, u3 * u3 + v3 * v3))
    far = max(max(u0 * u0 + v0 * v0, u1 * u1 + v1 * v1), max(u2 * u2 + v2 * v2, u3 * u3 + v3 * v3))
    if far <= radius * radius:
        return 1.0
    across = math.hypot(u2 - u0, v2 - v0) + math.hypot(u3 - u1, v3 - v1)
    if math.sqrt(near) > radius + across:
        return 0.0
    area = 0.5 * ((u2 - u0) * (v3 - v1) - (u3 - u1) * (v2 - v0))
    covered = (
        _wedge(u0, v0, u1, v1, radius)
        + _wedge(u1, v1, u2, v2, radius)
        + _wedge(u2, v2, u3, v3, radius)
        + _wedge(u3, v3, u0, v0, radius)
    )
    return min(max(covered / area, 0.0), 1.0)
