"""Images of the speckled bodies: exactly traced rays, integrated over each pixel's area."""

from __future__ import annotations

import numpy as np
from numba import njit

from drivers.twin.coverage import LATTICE, lattice_point
from drivers.twin.light import brightness
from drivers.twin.membrane import NEWTON_STEPS, SHAPE_NUMBERS, Membrane, membrane_at, newton_step
from drivers.twin.options import TwinOptions
from drivers.twin.speckle import speckle_at
from drivers.twin.sphere import hit_sphere
from drivers.twin.trace import BLOCKED, trace_line, trace_points

SPHERE, MEMBRANE = 1.0, 2.0

#: Rows of the array that `hit_line` fills.
HIT_ROWS = 15


def pack_body(options: TwinOptions, pressure_kpa: float, scene: str) -> tuple[float, ...]:
    """The body's numbers: kind, radius, speckle spacing, ring width, ring reflectance; then the membrane's polynomials.

    Padded for the sphere, so that one compiled kernel serves both.
    """
    if scene == "sphere":
        head = (SPHERE, options.sphere.radius_mm, options.sphere.speckle.spacing_mm, 0.0, 0.0)
        return (*head, *(0.0,) * SHAPE_NUMBERS)
    body = options.membrane
    head = (MEMBRANE, body.radius_mm, body.speckle.spacing_mm, body.ring_width_mm, body.ring)
    return (*head, *Membrane(body).polynomials(pressure_kpa))


@njit(inline="always")
def _into_body(x, y, z, pose):
    """A world vector along the body's axes."""
    return (
        pose[0] * x + pose[3] * y + pose[6] * z,
        pose[1] * x + pose[4] * y + pose[7] * z,
        pose[2] * x + pose[5] * y + pose[8] * z,
    )


@njit(inline="always")
def _into_world(x, y, z, pose):
    """A vector along the body's axes in the world."""
    return (
        pose[0] * x + pose[1] * y + pose[2] * z,
        pose[3] * x + pose[4] * y + pose[5] * z,
        pose[6] * x + pose[7] * y + pose[8] * z,
    )


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _turn_line(ox, oy, oz, dx, dy, dz, pose, bx, by, bz, ex, ey, ez):
    """Rays of a line in the body's frame."""
    for i in range(ox.shape[0]):
        bx[i], by[i], bz[i] = _into_body(ox[i] - pose[9], oy[i] - pose[10], oz[i] - pose[11], pose)
        ex[i], ey[i], ez[i] = _into_body(dx[i], dy[i], dz[i], pose)


@njit(cache=True, error_model="numpy")
def _reach_line(bx, by, bz, ex, ey, ez, near2):
    for i in range(bx.shape[0]):
        along = bx[i] * ex[i] + by[i] * ey[i] + bz[i] * ez[i]
        near2[i] = bx[i] * bx[i] + by[i] * by[i] + bz[i] * bz[i] - along * along


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _sphere_line(bx, by, bz, ex, ey, ez, pose, body, light, what, u, v, white, wx, wy, wz):
    for i in range(bx.shape[0]):
        what[i], u[i], v[i], x, y, z, nx, ny, nz = hit_sphere(bx[i], by[i], bz[i], ex[i], ey[i], ez[i], body[1])
        x, y, z = _into_world(x, y, z, pose)
        nx, ny, nz = _into_world(nx, ny, nz, pose)
        wx[i], wy[i], wz[i] = x + pose[9], y + pose[10], z + pose[11]
        white[i] = brightness(x + pose[9], y + pose[10], z + pose[11], nx, ny, nz, light)


@njit(cache=True, error_model="numpy")
def _start_line(bz, ez, body, t):
    for i in range(bz.shape[0]):
        t[i] = (body[5] - bz[i]) / ez[i]


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _newton_line(bx, by, bz, ex, ey, ez, body, t, step):
    for i in range(bx.shape[0]):
        step[i] = newton_step(t[i], bx[i], by[i], bz[i], ex[i], ey[i], ez[i], body[1], body[5:])
        t[i] -= step[i]


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _membrane_line(bx, by, bz, ex, ey, ez, t, step, pose, body, light, what, u, v, white, wx, wy, wz):
    for i in range(bx.shape[0]):
        what[i], u[i], v[i], x, y, z, nx, ny, nz = membrane_at(
            t[i], step[i], bx[i], by[i], bz[i], ex[i], ey[i], ez[i], body[1], body[3], body[5:]
        )
        x, y, z = _into_world(x, y, z, pose)
        nx, ny, nz = _into_world(nx, ny, nz, pose)
        wx[i], wy[i], wz[i] = x + pose[9], y + pose[10], z + pose[11]
        white[i] = brightness(x + pose[9], y + pose[10], z + pose[11], nx, ny, nz, light)


@njit(cache=True, nogil=True, error_model="numpy")
def hit_line(r, pose, body, light, h):
    """Where world rays ``r`` (rows as of `trace_line`) first meet the body.

    Rows of ``h`` ``(HIT_ROWS, count)``: what (as `membrane_at` tells it), material u and v (mm), brightness of white
    paper there, place in the world x, y, z (mm); the others are working space. Each loop is simple enough for the
    compiler to use vector registers.
    """
    _turn_line(r[0], r[1], r[2], r[3], r[4], r[5], pose, h[7], h[8], h[9], h[10], h[11], h[12])
    # only rays that pass the body's middle within its reach can meet it
    _reach_line(h[7], h[8], h[9], h[10], h[11], h[12], h[13])
    reach2 = (body[1] + body[3]) ** 2 + body[5] ** 2
    first, last = 0, h.shape[1]
    while first < last and not h[13, first] < reach2:
        first += 1
    while first < last and not h[13, last - 1] < reach2:
        last -= 1
    h[0, :first], h[0, last:] = 0.0, 0.0
    if first == last:
        return
    what, u, v, white = h[0, first:last], h[1, first:last], h[2, first:last], h[3, first:last]
    wx, wy, wz = h[4, first:last], h[5, first:last], h[6, first:last]
    bx, by, bz = h[7, first:last], h[8, first:last], h[9, first:last]
    ex, ey, ez = h[10, first:last], h[11, first:last], h[12, first:last]
    if body[0] == SPHERE:
        _sphere_line(bx, by, bz, ex, ey, ez, pose, body, light, what, u, v, white, wx, wy, wz)
        return
    t, step = h[13, first:last], h[14, first:last]
    _start_line(bz, ez, body, t)
    for _ in range(NEWTON_STEPS):
        _newton_line(bx, by, bz, ex, ey, ez, body, t, step)
    _membrane_line(bx, by, bz, ex, ey, ez, t, step, pose, body, light, what, u, v, white, wx, wy, wz)


@njit(cache=True, error_model="numpy")
def _look(ray, pose, body, coefficients, light, hit, kind, value):
    """What traced rays see: kind of surface and view in one number, and its brightness."""
    hit_line(ray, pose, body, light, hit)
    for i in range(kind.shape[0]):
        what = hit[0, i]
        if ray[6, i] == BLOCKED:
            kind[i], value[i] = -1.0, 0.0
            continue
        kind[i], value[i] = what + 10.0 * (ray[6, i] + 1.0), light[12]
        if what == 1.0:
            value[i] = hit[3, i] * speckle_at(hit[1, i], hit[2, i], coefficients, body[2])
        elif what == 2.0:
            value[i] = hit[3, i] * body[4]


@njit(cache=True, error_model="numpy")
def _pixel(column, row, cam, prism, pose, body, coefficients, light, work):
    """Mean of the lattice of exactly traced points over one pixel's area; ``work`` ``(11 + HIT_ROWS, LATTICE)``."""
    for k in range(LATTICE):
        x, y = lattice_point(k)
        work[7, k], work[8, k] = column + x, row + y
    trace_points(work[7], work[8], cam, prism, work)
    _look(work, pose, body, coefficients, light, work[11:], work[9], work[10])
    return work[10].mean()


@njit(cache=True, nogil=True, error_model="numpy")
def render_body_rows(first, last, nodes, weights, cam, prism, pose, body, coefficients, light, out):
    """Rows ``first`` to ``last`` of the sharp image into ``out`` ``(H, W)``.

    Gauss-Legendre ``nodes`` and ``weights`` on -1/2..1/2 in either direction; where they see different surfaces or
    views, the lattice instead.
    """
    width = out.shape[1]
    ray, hit, single = np.empty((7, width)), np.empty((HIT_ROWS, width)), np.empty((11 + HIT_ROWS, LATTICE))
    seen, value = np.empty(width), np.empty(width)
    total, kind, mixed = np.empty(width), np.empty(width), np.empty(width, np.bool_)
    for r in range(first, last):
        total[:], mixed[:] = 0.0, False
        for j in range(len(nodes)):
            for i in range(len(nodes)):
                trace_line(nodes[i], r + nodes[j], cam, prism, ray)
                _look(ray, pose, body, coefficients, light, hit, seen, value)
                if i == 0 and j == 0:
                    kind[:] = seen
                for c in range(width):
                    mixed[c] |= seen[c] != kind[c]
                    total[c] += weights[i] * weights[j] * value[c]
        for c in range(width):
            if mixed[c]:
                total[c] = _pixel(float(c), float(r), cam, prism, pose, body, coefficients, light, single)
            out[r, c] = total[c]
