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

_NO_PRISM = np.zeros(18)


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


@njit(cache=True, inline="always")
def _refract(dx, dy, dz, nx, ny, nz, ratio):
    """Snell: unit direction d onto a face with unit normal n (along d), ratio = n_before / n_after."""
    cos_in = dx * nx + dy * ny + dz * nz
    sin2_out = ratio * ratio * (1.0 - cos_in * cos_in)
    if sin2_out > 1.0:
        return np.nan, np.nan, np.nan
    k = np.sqrt(1.0 - sin2_out) - ratio * cos_in
    return ratio * dx + k * nx, ratio * dy + k * ny, ratio * dz + k * nz


@njit(cache=True)
def trace_pixel(column, row, cam, prism, face):
    """One pixel -> (ox, oy, oz, dx, dy, dz, side); ``prism[0] == 0`` means that there is none.

    ``face`` 0 takes the face that the ray meets; -1 or 1 that face, extended without bounds (for the inverse).
    """
    x, y = _undistort((column - cam[2]) / cam[0], (row - cam[3]) / cam[1], cam[4], cam[5], cam[6], cam[7])
    norm = np.sqrt(x * x + y * y + 1.0)
    dx = (x * cam[11] + y * cam[14] + cam[17]) / norm
    dy = (x * cam[12] + y * cam[15] + cam[18]) / norm
    dz = (x * cam[13] + y * cam[16] + cam[19]) / norm
    ox, oy, oz = cam[8], cam[9], cam[10]
    n = prism[0]
    if n == 0.0:
        return ox, oy, oz, dx, dy, dz, DIRECT
    sin_b, cos_b, thickness, half_w, half_h = prism[1], prism[2], prism[3], prism[4], prism[5]
    # into the prism's frame
    qx, qy, qz = ox - prism[6], oy - prism[7], oz - prism[8]
    px = prism[9] * qx + prism[10] * qy + prism[11] * qz
    py = prism[12] * qx + prism[13] * qy + prism[14] * qz
    pz = prism[15] * qx + prism[16] * qy + prism[17] * qz
    ex = prism[9] * dx + prism[10] * dy + prism[11] * dz
    ey = prism[12] * dx + prism[13] * dy + prism[14] * dz
    ez = prism[15] * dx + prism[16] * dy + prism[17] * dz
    t = (-thickness - py) / ey
    ax, ay, az = px + t * ex, -thickness, pz + t * ez
    if face == 0 and (abs(ax) > half_w or abs(az) > half_h):
        tf = -py / ey  # past it only if the ray stays outside up to the plane of the edge
        bx, bz = px + tf * ex, pz + tf * ez
        if (ax > half_w and bx > half_w) or (ax < -half_w and bx < -half_w):
            return ox, oy, oz, dx, dy, dz, DIRECT
        if (az > half_h and bz > half_h) or (az < -half_h and bz < -half_h):
            return ox, oy, oz, dx, dy, dz, DIRECT
        return np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, BLOCKED
    ex, ey, ez = _refract(ex, ey, ez, 0.0, 1.0, 0.0, 1.0 / n)
    # the roof is convex: the ray leaves through the face that it meets first
    t_right = -(ax * sin_b + ay * cos_b) / (ex * sin_b + ey * cos_b)
    t_left = -(-ax * sin_b + ay * cos_b) / (-ex * sin_b + ey * cos_b)
    side = RIGHT
    t = t_right
    nx = sin_b
    if face == LEFT or (face == 0 and t_left < t_right):
        side = LEFT
        t = t_left
        nx = -sin_b
    ax, ay, az = ax + t * ex, ay + t * ey, az + t * ez
    ex, ey, ez = _refract(ex, ey, ez, nx, cos_b, 0.0, n)
    if np.isnan(ex) or (face == 0 and (abs(ax) > half_w or abs(az) > half_h)):
        return np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, BLOCKED
    # back to the world
    ox = prism[6] + prism[9] * ax + prism[12] * ay + prism[15] * az
    oy = prism[7] + prism[10] * ax + prism[13] * ay + prism[16] * az
    oz = prism[8] + prism[11] * ax + prism[14] * ay + prism[17] * az
    dx = prism[9] * ex + prism[12] * ey + prism[15] * ez
    dy = prism[10] * ex + prism[13] * ey + prism[16] * ez
    dz = prism[11] * ex + prism[14] * ey + prism[17] * ez
    return ox, oy, oz, dx, dy, dz, side


@njit(cache=True, nogil=True)
def _trace_many(first, last, pixels, cam, prism, origin, direction, side):
    for i in range(first, last):
        ox, oy, oz, dx, dy, dz, s = trace_pixel(pixels[i, 0], pixels[i, 1], cam, prism, 0)
        origin[i, 0], origin[i, 1], origin[i, 2] = ox, oy, oz
        direction[i, 0], direction[i, 1], direction[i, 2] = dx, dy, dz
        side[i] = s


def pack_prism(prism: Biprism | None) -> FloatArray:
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
        if np.isnan(change) or change < 1e-9:
            break
    if not change < 1e-7:
        return np.nan, np.nan
    return column, row


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
