"""The dotted cube as seen by a ray, and its image by exact area coverage.

The faces: 0 the one that runs to the right in the corner pose, 1 the left one (these carry dots), 2 and 3 their
opposites, 4 top, 5 bottom. On faces 0 and 1 the first coordinate runs from the edge, the second is z.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from drivers.twin.coverage import LATTICE, disc_share, lattice_point
from drivers.twin.light import brightness, pack_light
from drivers.twin.optics import FloatArray
from drivers.twin.options import TwinOptions
from drivers.twin.placement import Pose, cube_size_mm
from drivers.twin.trace import BLOCKED, trace_line, trace_pixel

#: What a ray meets beside faces 0 to 5; SHADOW is the prism's flank.
NOTHING, SHADOW = 6, -1


def pack_cube(options: TwinOptions) -> tuple[float, ...]:
    """The cube's 10 numbers for the kernels."""
    cube = options.cube
    side, height = cube_size_mm(options)
    grid = (float(cube.columns), float(cube.rows), cube.pitch_mm, cube.dot_diameter_mm / 2.0, cube.margin_mm)
    return (side, height / 2.0, *grid, cube.paper, cube.ink, cube.bare)


def dot_labels(options: TwinOptions) -> tuple[FloatArray, FloatArray]:
    """Centres ``(N, 3)`` of all dots in the cube's own frame, mm, and their faces' outward normals ``(N, 3)``.

    In the order of the labels: face (right, left), row (top first), column (next to the edge first).
    """
    cube = options.cube
    face, row, column = np.meshgrid(range(2), range(cube.rows), range(cube.columns), indexing="ij")
    along = cube.margin_mm + column * cube.pitch_mm
    z = ((cube.rows - 1) / 2.0 - row) * cube.pitch_mm
    right = face == 0
    centres = np.stack([np.where(right, along, 0.0), np.where(right, 0.0, along), z], axis=-1)
    normals = np.stack([np.where(right, 0.0, -1.0), np.where(right, -1.0, 0.0), np.zeros(face.shape)], axis=-1)
    return centres.reshape(-1, 3).astype(np.float64), normals.reshape(-1, 3)


@njit(cache=True)
def hit_cube(ox, oy, oz, dx, dy, dz, pose, cube):
    """Where a world ray first meets the cube: (face, first coordinate, second coordinate) in mm."""
    qx, qy, qz = ox - pose[9], oy - pose[10], oz - pose[11]
    near, far = -np.inf, np.inf
    face = NOTHING
    body_o = (
        pose[0] * qx + pose[3] * qy + pose[6] * qz,
        pose[1] * qx + pose[4] * qy + pose[7] * qz,
        pose[2] * qx + pose[5] * qy + pose[8] * qz,
    )
    body_d = (
        pose[0] * dx + pose[3] * dy + pose[6] * dz,
        pose[1] * dx + pose[4] * dy + pose[7] * dz,
        pose[2] * dx + pose[5] * dy + pose[8] * dz,
    )
    for axis in range(3):
        o, d = body_o[axis], body_d[axis]
        low = -cube[1] if axis == 2 else 0.0
        high = cube[1] if axis == 2 else cube[0]
        if d == 0.0:
            if o < low or o > high:
                return NOTHING, 0.0, 0.0
            continue
        enter, leave = (low - o) / d, (high - o) / d
        at_low = enter <= leave
        if not at_low:
            enter, leave = leave, enter
        if enter > near:
            near = enter
            if axis == 0:
                face = 1 if at_low else 2
            elif axis == 1:
                face = 0 if at_low else 3
            else:
                face = 5 if at_low else 4
        far = min(far, leave)
    if near > far or near <= 0.0:
        return NOTHING, 0.0, 0.0
    a, b, c = body_o[0] + near * body_d[0], body_o[1] + near * body_d[1], body_o[2] + near * body_d[2]
    if face == 0 or face == 3:
        return face, a, c
    if face == 1 or face == 2:
        return face, b, c
    return face, a, b


@njit(cache=True)
def _white(face, u, v, pose, cube, light):
    """Brightness of white paper at a point of a face."""
    a, b, c = u, v, 0.0
    na, nb, nc = 0.0, 0.0, 0.0
    if face == 0:
        a, b, c, nb = u, 0.0, v, -1.0
    elif face == 1:
        a, b, c, na = 0.0, u, v, -1.0
    elif face == 2:
        a, b, c, na = cube[0], u, v, 1.0
    elif face == 3:
        a, b, c, nb = u, cube[0], v, 1.0
    else:
        nc = 1.0 if face == 4 else -1.0
        c = nc * cube[1]
    return brightness(
        pose[0] * a + pose[1] * b + pose[2] * c + pose[9],
        pose[3] * a + pose[4] * b + pose[5] * c + pose[10],
        pose[6] * a + pose[7] * b + pose[8] * c + pose[11],
        pose[0] * na + pose[1] * nb + pose[2] * nc,
        pose[3] * na + pose[4] * nb + pose[5] * nc,
        pose[6] * na + pose[7] * nb + pose[8] * nc,
        light,
    )


@njit(cache=True)
def _nearest_dot(u, v, cube):
    """Centre of the dot of the grid that is nearest to a point of a dotted face."""
    column = min(max(np.floor((u - cube[6]) / cube[4] + 0.5), 0.0), cube[2] - 1.0)
    half = (cube[3] - 1.0) / 2.0
    row = min(max(np.floor(half - v / cube[4] + 0.5), 0.0), cube[3] - 1.0)
    return cube[6] + column * cube[4], (half - row) * cube[4]


@njit(cache=True)
def sample_cube(column, row, cam, prism, pose, cube, light):
    """Brightness that one exactly traced point of the image sees; hard edges."""
    ox, oy, oz, dx, dy, dz, side = trace_pixel(column, row, cam, prism, 0)
    if side == BLOCKED:
        return 0.0
    face, u, v = hit_cube(ox, oy, oz, dx, dy, dz, pose, cube)
    if face == NOTHING:
        return light[12]
    white = _white(face, u, v, pose, cube, light)
    if face > 1:
        return white * cube[9]
    cu, cv = _nearest_dot(u, v, cube)
    inside = (u - cu) ** 2 + (v - cv) ** 2 <= cube[5] ** 2
    return white * (cube[8] if inside else cube[7])


@njit(cache=True)
def sample_cube_pixel(column, row, cam, prism, pose, cube, light):
    """Mean of the lattice of exactly traced points over a pixel's area."""
    total = 0.0
    for k in range(LATTICE):
        x, y = lattice_point(k)
        total += sample_cube(column + x, row + y, cam, prism, pose, cube, light)
    return total / LATTICE


@njit(cache=True)
def _look_along_line(row, rays, what, u, v, cam, prism, pose, cube):
    """What the pixel corners on one line (row) see: face and side in one number, and the place on the face."""
    trace_line(-0.5, row, cam, prism, rays)
    for i in range(what.shape[0]):
        if rays[6, i] == BLOCKED:
            what[i] = SHADOW
            continue
        face, u[i], v[i] = hit_cube(rays[0, i], rays[1, i], rays[2, i], rays[3, i], rays[4, i], rays[5, i], pose, cube)
        what[i] = face + 10 * (int(rays[6, i]) + 1)


@njit(cache=True, nogil=True)
def render_cube_rows(first, last, cam, prism, pose, cube, light, out):
    """Rows ``first`` to ``last`` of the image of the cube, sharp, into ``out`` ``(H, W)``.

    Pixel corners are traced exactly. A pixel whose corners lie on one dotted face sees a quadrilateral of it; the
    share that a dot covers is computed in closed form. Pixels that an edge crosses are sampled.
    """
    width = out.shape[1]
    top, bottom = np.empty(width + 1, np.int64), np.empty(width + 1, np.int64)
    top_u, top_v = np.empty(width + 1), np.empty(width + 1)
    low_u, low_v = np.empty(width + 1), np.empty(width + 1)
    rays = np.empty((7, width + 1))
    _look_along_line(first - 0.5, rays, top, top_u, top_v, cam, prism, pose, cube)
    for r in range(first, last):
        _look_along_line(r + 0.5, rays, bottom, low_u, low_v, cam, prism, pose, cube)
        for c in range(width):
            kind = top[c]
            if top[c + 1] != kind or bottom[c] != kind or bottom[c + 1] != kind:
                out[r, c] = sample_cube_pixel(c, r, cam, prism, pose, cube, light)
            elif kind == SHADOW:
                out[r, c] = 0.0
            elif kind % 10 == NOTHING:
                out[r, c] = light[12]
            else:
                face = kind % 10
                us = (top_u[c], top_u[c + 1], low_u[c + 1], low_u[c])
                vs = (top_v[c], top_v[c + 1], low_v[c + 1], low_v[c])
                u, v = (us[0] + us[1] + us[2] + us[3]) / 4.0, (vs[0] + vs[1] + vs[2] + vs[3]) / 4.0
                share = cube[9]
                if face <= 1:
                    cu, cv = _nearest_dot(u, v, cube)
                    share = cube[7] + (cube[8] - cube[7]) * disc_share(us, vs, cu, cv, cube[5])
                out[r, c] = _white(face, u, v, pose, cube, light) * share
        top, bottom = bottom, top
        top_u, low_u = low_u, top_u
        top_v, low_v = low_v, top_v


Packed = tuple[float, ...]


def cube_arguments(options: TwinOptions, pose: Pose) -> tuple[Packed, Packed, Packed]:
    """The pose, cube and light numbers that the kernels of this module take."""
    return pose.packed(), pack_cube(options), pack_light(options.light)
