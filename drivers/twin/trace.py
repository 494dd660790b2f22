"""The exact ray trace: pixel -> lens distortion -> back face -> roof face -> object, and its inverse.

Snell's law in vector form at both faces; no thin-prism or paraxial shortcut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.twin.bands import run_in_bands
from drivers.twin.optics import Biprism, CameraOptics, FloatArray

#: Where a ray left the prism.
DIRECT, LEFT, RIGHT, BLOCKED = 0, -1, 1, 9

_NO_PRISM = (0.0,) * 19


@dataclass(frozen=True)
class Rays:
    """Rays in object space: a point ``(N, 3)`` mm on each, its unit direction ``(N, 3)``, and the ``side``.

    ``side`` ``(N,)``: -1 left roof face, 1 right roof face, 0 past the prism, 9 blocked by its flanks (NaN).
    """

    origin_mm: FloatArray
    direction: FloatArray
    side: NDArray[np.int8]


@njit(cache=True, inline="always")
def _undistort(x, y, k1, k2, p1, p2):
    """Brown 1971: from the measured to the ideal image point, both over the focal length."""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * k2)
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


@njit(inline="always")
def _trace(column, row, cam, prism, face):
    """`trace_pixel` without a branch, so that a loop over it runs on vector registers."""
    x, y = _undistort((column - cam[2]) * cam[20], (row - cam[3]) * cam[20], cam[4], cam[5], cam[6], cam[7])
    unit = 1.0 / np.sqrt(x * x + y * y + 1.0)
    dx = (x * cam[11] + y * cam[14] + cam[17]) * unit
    dy = (x * cam[12] + y * cam[15] + cam[18]) * unit
    dz = (x * cam[13] + y * cam[16] + cam[19]) * unit
    n, sin_b, cos_b, thickness, half_w, half_h = prism[0], prism[1], prism[2], prism[3], prism[4], prism[5]
    # into the prism's frame
    qx, qy, qz = cam[8] - prism[6], cam[9] - prism[7], cam[10] - prism[8]
    px = prism[9] * qx + prism[10] * qy + prism[11] * qz
    py = prism[12] * qx + prism[13] * qy + prism[14] * qz
    pz = prism[15] * qx + prism[16] * qy + prism[17] * qz
    ex = prism[9] * dx + prism[10] * dy + prism[11] * dz
    ey = prism[12] * dx + prism[13] * dy + prism[14] * dz
    ez = prism[15] * dx + prism[16] * dy + prism[17] * dz
    per_depth = 1.0 / ey
    to_back, to_edge = -(thickness + py) * per_depth, -py * per_depth
    ax, az = px + to_back * ex, pz + to_back * ez
    bx, bz = px + to_edge * ex, pz + to_edge * ez
    # past the prism if the ray stays on one side of it from the back face to the plane of the edge
    beside = ((ax > half_w) & (bx > half_w)) | ((ax < -half_w) & (bx < -half_w))
    over = ((az > half_h) & (bz > half_h)) | ((az < -half_h) & (bz < -half_h))
    past = beside | over | (n == 0.0)
    blocked = (abs(ax) > half_w) | (abs(az) > half_h)
    # Snell at the back face, whose normal is the prism's y axis
    ex, ez = ex * prism[18], ez * prism[18]
    ey = np.sqrt(1.0 - ex * ex - ez * ez)
    # the roof is convex: the ray leaves through the face that it meets first
    depth, forward = -thickness * cos_b, ey * cos_b
    across, sideways = ax * sin_b, ex * sin_b
    left_first = (depth - across) * (forward + sideways) > (depth + across) * (forward - sideways)
    side = -1.0 if left_first else 1.0
    side = side if face == 0.0 else face
    cos_in = forward + side * sideways
    inside = -(depth + side * across) / cos_in
    ax, ay, az = ax + inside * ex, inside * ey - thickness, az + inside * ez
    # Snell in vector form at the roof: d' = n d + (cos_out - n cos_in) normal
    cos2_out = 1.0 - n * n * (1.0 - cos_in * cos_in)
    turn = np.sqrt(cos2_out) - n * cos_in
    ex, ey, ez = n * ex + turn * side * sin_b, n * ey + turn * cos_b, n * ez
    blocked = blocked | (abs(ax) > half_w) | (abs(az) > half_h) | (cos2_out < 0.0)
    if face == 0.0:
        side = 9.0 if blocked else side
        side = 0.0 if past else side
    direct = side == 0.0
    bad = np.nan if side == 9.0 else 0.0
    # back to the world
    gx = prism[6] + prism[9] * ax + prism[12] * ay + prism[15] * az
    gy = prism[7] + prism[10] * ax + prism[13] * ay + prism[16] * az
    gz = prism[8] + prism[11] * ax + prism[14] * ay + prism[17] * az
    hx = prism[9] * ex + prism[12] * ey + prism[15] * ez
    hy = prism[10] * ex + prism[13] * ey + prism[16] * ez
    hz = prism[11] * ex + prism[14] * ey + prism[17] * ez
    return (
        (cam[8] if direct else gx) + bad,
        (cam[9] if direct else gy) + bad,
        (cam[10] if direct else gz) + bad,
        (dx if direct else hx) + bad,
        (dy if direct else hy) + bad,
        (dz if direct else hz) + bad,
        side,
    )


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def trace_pixel(column, row, cam, prism, face):
    """One pixel -> (ox, oy, oz, dx, dy, dz, side); ``prism[0] == 0`` means that there is none.

    ``face`` 0 takes the face that the ray meets; -1 or 1 that face, extended without bounds (for the inverse).
    ``cam`` and ``prism`` are tuples (`CameraOptics.packed`, `pack_prism`): the compiler knows that a loop's output
    does not overlap them.
    """
    ox, oy, oz, dx, dy, dz, side = _trace(column, row, cam, prism, float(face))
    return ox, oy, oz, dx, dy, dz, int(side)


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _fill(columns, rows, cam, prism, ox, oy, oz, dx, dy, dz, side):
    for i in range(ox.shape[0]):
        ox[i], oy[i], oz[i], dx[i], dy[i], dz[i], side[i] = _trace(columns[i], rows[i], cam, prism, 0.0)


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _fill_line(first, row, cam, prism, ox, oy, oz, dx, dy, dz, side):
    for i in range(ox.shape[0]):
        ox[i], oy[i], oz[i], dx[i], dy[i], dz[i], side[i] = _trace(first + i, row, cam, prism, 0.0)


@njit(cache=True)
def trace_line(first, row, cam, prism, out):
    """Points of one image line at columns ``first``, ``first`` + 1, ... into ``out`` ``(7, count)``.

    Its rows are those of `trace_pixel`'s answer.
    """
    _fill_line(first, row, cam, prism, out[0], out[1], out[2], out[3], out[4], out[5], out[6])


@njit(cache=True)
def trace_points(columns, rows, cam, prism, out):
    """The same of any points of the image, ``columns`` and ``rows`` ``(count,)``."""
    _fill(columns, rows, cam, prism, out[0], out[1], out[2], out[3], out[4], out[5], out[6])


@njit(cache=True, nogil=True)
def _trace_many(first, last, pixels, cam, prism, origin, direction, side):
    block = np.zeros((9, 512))
    while first < last:
        count = min(block.shape[1], last - first)
        for i in range(count):
            block[7, i], block[8, i] = pixels[first + i, 0], pixels[first + i, 1]
        # the whole block: a slice of its rows would not be contiguous to the compiler
        trace_points(block[7], block[8], cam, prism, block)
        for i in range(count):
            for k in range(3):
                origin[first + i, k], direction[first + i, k] = block[k, i], block[3 + k, i]
            side[first + i] = np.int8(block[6, i])
        first += count


def pack_prism(prism: Biprism | None) -> tuple[float, ...]:
    """The prism's numbers for the kernels; zeros for none."""
    return _NO_PRISM if prism is None else prism.packed()


def trace_pixels(camera: CameraOptics, prism: Biprism | None, pixels_px: FloatArray) -> Rays:
    """Rays in object space of pixels ``(N, 2)`` (column, row)."""
    pixels = np.ascontiguousarray(pixels_px, np.float64).reshape(-1, 2)
    origin, direction = np.empty((len(pixels), 3)), np.empty((len(pixels), 3))
    side = np.empty(len(pixels), np.int8)
    cam, glass = camera.packed(), pack_prism(prism)
    run_in_bands(len(pixels), lambda first, last: _trace_many(first, last, pixels, cam, glass, origin, direction, side))
    return Rays(origin, direction, side)


@njit(cache=True)
def _miss(column, row, cam, prism, face, point):
    """By how much a pixel's ray passes a point, along the camera's columns and rows (mm)."""
    ox, oy, oz, dx, dy, dz, _ = trace_pixel(column, row, cam, prism, face)
    qx, qy, qz = point[0] - ox, point[1] - oy, point[2] - oz
    along = qx * dx + qy * dy + qz * dz
    qx, qy, qz = qx - along * dx, qy - along * dy, qz - along * dz
    return qx * cam[11] + qy * cam[12] + qz * cam[13], qx * cam[14] + qy * cam[15] + qz * cam[16]


@njit(cache=True)
def project_point(point, column, row, cam, prism, face):
    """Newton's method on `_miss` from a start pixel; (column, row), NaN where it does not converge."""
    step = 1e-3
    for _ in range(40):
        a, b = _miss(column, row, cam, prism, face, point)
        ac, bc = _miss(column + step, row, cam, prism, face, point)
        ar, br = _miss(column, row + step, cam, prism, face, point)
        j11, j21, j12, j22 = (ac - a) / step, (bc - b) / step, (ar - a) / step, (br - b) / step
        det = j11 * j22 - j12 * j21
        dc, dr = -(j22 * a - j12 * b) / det, -(j11 * b - j21 * a) / det
        column += dc
        row += dr
        change = abs(dc) + abs(dr)
        if np.isnan(change):
            break
        if change < 1e-9:
            return column, row
    return np.nan, np.nan


@njit(cache=True, nogil=True)
def _project_many(first, last, points, start, cam, prism, face, out):
    for i in range(first, last):
        column, row = project_point(points[i], start[i, 0], start[i, 1], cam, prism, face)
        out[i, 0], out[i, 1] = np.nan, np.nan
        if not np.isnan(column) and trace_pixel(column, row, cam, prism, 0)[6] == face:
            out[i, 0], out[i, 1] = column, row


def project(camera: CameraOptics, prism: Biprism | None, points_mm: FloatArray, side: int = DIRECT) -> FloatArray:
    """Exact images ``(N, 2)`` px of points ``(N, 3)`` mm through one roof face, or past the prism (``DIRECT``).

    The inverse of the trace by Newton's method, to better than 1e-6 px. NaN where no such ray exists. The
    sensor's borders do not cut: the caller decides what lies on it.
    """
    points = np.ascontiguousarray(points_mm, np.float64).reshape(-1, 3)
    local = (points - np.asarray(camera.position_mm)) @ camera.rotation.T
    scale = camera.focal_length_mm / camera.pixel_size_mm
    start = local[:, :2] / local[:, 2:3] * scale + np.asarray(camera.principal_px)
    out = np.empty((len(points), 2))
    cam, glass = camera.packed(), _NO_PRISM if side == DIRECT else pack_prism(prism)
    run_in_bands(
        len(points), lambda first, last: _project_many(first, last, points, start, cam, glass, side, out), small=512
    )
    if side == DIRECT:
        hidden = trace_pixels(camera, prism, np.nan_to_num(out)).side != DIRECT
        out[hidden] = np.nan
    return out
