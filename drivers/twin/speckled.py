"""Images of the speckled bodies: exactly traced rays, integrated over each pixel's area."""

from __future__ import annotations

import numpy as np
from numba import njit

from drivers.twin.light import brightness
from drivers.twin.membrane import Membrane, hit_membrane
from drivers.twin.optics import FloatArray
from drivers.twin.options import TwinOptions
from drivers.twin.sphere import hit_sphere
from drivers.twin.speckle import speckle_at
from drivers.twin.trace import BLOCKED, trace_pixel

SPHERE, MEMBRANE = 1, 2

#: Samples per axis in the pixels that an outline or the prism's edge crosses.
EDGE_SAMPLES = 8


def pack_body(options: TwinOptions, pressure_kpa: float, scene: str) -> tuple[FloatArray, FloatArray]:
    """The body's numbers ``(5,)`` (kind, radius, ring width, ring reflectance, speckle spacing) and its table."""
    if scene == "sphere":
        sphere = options.sphere
        return np.array([SPHERE, sphere.radius_mm, 0.0, 0.0, sphere.speckle.spacing_mm]), np.zeros((1, 8))
    body = options.membrane
    head = [MEMBRANE, body.radius_mm, body.ring_width_mm, body.ring, body.speckle.spacing_mm]
    return np.array(head), Membrane(body).table(pressure_kpa)


@njit(cache=True)
def hit_body(ox, oy, oz, dx, dy, dz, pose, body, table):
    """Where a world ray first meets the body, as `hit_membrane` tells it, in the body's frame."""
    qx, qy, qz = ox - pose[9], oy - pose[10], oz - pose[11]
    bx = pose[0] * qx + pose[3] * qy + pose[6] * qz
    by = pose[1] * qx + pose[4] * qy + pose[7] * qz
    bz = pose[2] * qx + pose[5] * qy + pose[8] * qz
    ex = pose[0] * dx + pose[3] * dy + pose[6] * dz
    ey = pose[1] * dx + pose[4] * dy + pose[7] * dz
    ez = pose[2] * dx + pose[5] * dy + pose[8] * dz
    if body[0] == SPHERE:
        return hit_sphere(bx, by, bz, ex, ey, ez, body[1])
    return hit_membrane(bx, by, bz, ex, ey, ez, body[1], body[2], table)


@njit(cache=True)
def sample_body(column, row, cam, prism, pose, body, table, coefficients, light):
    """What one exactly traced point of the image sees: (kind of surface and view in one number, brightness)."""
    ox, oy, oz, dx, dy, dz, side = trace_pixel(column, row, cam, prism, 0)
    if side == BLOCKED:
        return -1, 0.0
    what, u, v, x, y, z, nx, ny, nz = hit_body(ox, oy, oz, dx, dy, dz, pose, body, table)
    kind = what + 10 * (side + 1)
    if what == 0:
        return kind, light[12]
    white = brightness(
        pose[0] * x + pose[1] * y + pose[2] * z + pose[9],
        pose[3] * x + pose[4] * y + pose[5] * z + pose[10],
        pose[6] * x + pose[7] * y + pose[8] * z + pose[11],
        pose[0] * nx + pose[1] * ny + pose[2] * nz,
        pose[3] * nx + pose[4] * ny + pose[5] * nz,
        pose[6] * nx + pose[7] * ny + pose[8] * nz,
        light,
    )
    return kind, white * (body[3] if what == 2 else speckle_at(u, v, coefficients, body[4]))


@njit(cache=True, nogil=True)
def render_body_rows(first, last, nodes, weights, cam, prism, pose, body, table, coefficients, light, out):
    """Rows ``first`` to ``last`` of the sharp image into ``out`` ``(H, W)``.

    Gauss-Legendre ``nodes`` and ``weights`` on -1/2..1/2 in either direction; where they see different surfaces or
    views, an even grid instead.
    """
    count = len(nodes)
    for r in range(first, last):
        for c in range(out.shape[1]):
            total = 0.0
            kind, mixed = -2, False
            for j in range(count):
                for i in range(count):
                    seen, value = sample_body(
                        c + nodes[i], r + nodes[j], cam, prism, pose, body, table, coefficients, light
                    )
                    mixed = mixed or (kind != -2 and seen != kind)
                    kind = seen
                    total += weights[i] * weights[j] * value
            if mixed:
                total = 0.0
                for j in range(EDGE_SAMPLES):
                    for i in range(EDGE_SAMPLES):
                        _, value = sample_body(
                            c - 0.5 + (i + 0.5) / EDGE_SAMPLES,
                            r - 0.5 + (j + 0.5) / EDGE_SAMPLES,
                            cam, prism, pose, body, table, coefficients, light,
                        )  # fmt: skip
                        total += value / (EDGE_SAMPLES * EDGE_SAMPLES)
            out[r, c] = total


@njit(cache=True, nogil=True)
def hit_many(first, last, origin, direction, pose, body, table, what, material, place):
    """`hit_body` of rays ``first`` to ``last``: kind of surface, material point (mm), world point (mm)."""
    for i in range(first, last):
        o, d = origin[i], direction[i]
        what[i], material[i], place[i] = 0, np.nan, np.nan
        if np.isnan(o[0]):
            continue
        kind, u, v, x, y, z, _, _, _ = hit_body(o[0], o[1], o[2], d[0], d[1], d[2], pose, body, table)
        what[i] = kind
        if kind == 0:
            continue
        material[i, 0], material[i, 1] = u, v
        for k in range(3):
            place[i, k] = pose[3 * k] * x + pose[3 * k + 1] * y + pose[3 * k + 2] * z + pose[9 + k]
