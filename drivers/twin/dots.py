"""The truth about the cube's dots in one view: where their centres are and which of them are visible."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.twin.cube import dot_labels
from drivers.twin.optics import Biprism, CameraOptics, FloatArray
from drivers.twin.options import TwinOptions
from drivers.twin.placement import Pose
from drivers.twin.trace import project, trace_pixels

#: A visible dot is seen at this angle from its normal at most.
STEEPEST_DEG = 75.0
#: and keeps this distance from the sensor's border, the split and the prism's edges.
CLEARANCE_PX = 2.0

_RIM = 16


@dataclass(frozen=True)
class DotView:
    """The dots of both faces in one view.

    ``side``: 0 past the prism, -1 and 1 through its left and right roof faces. ``index`` ``(N,)``: label, face by
    face (right, left), row by row from the top, column by column from the edge. ``xyz_mm`` ``(N, 3)``: centre in
    the world. ``xy_px`` ``(N, 2)``: its exact image, NaN where there is none. ``visible`` ``(N,)``: the whole dot is in
    this view, unoccluded, seen at no more than 75 degrees from its normal, 2 px clear of the view's borders.
    """

    side: int
    index: NDArray[np.int64]
    xyz_mm: FloatArray
    xy_px: FloatArray
    visible: NDArray[np.bool_]


def see_dots(options: TwinOptions, camera: CameraOptics, prism: Biprism | None, pose: Pose, side: int) -> DotView:
    """All dots of the cube in a pose, as one view has them.

    The cube is convex: a point of a face that is turned towards the ray is hidden by nothing.
    """
    body, body_normals = dot_labels(options)
    centres, normals = pose.apply(body), body_normals @ pose.rotation.T
    centre_px = project(camera, prism, centres, side)
    turn = np.linspace(0.0, 2.0 * math.pi, _RIM, endpoint=False)
    radius = options.cube.dot_diameter_mm / 2.0
    up = pose.rotation[:, 2]
    along = np.cross(normals, up)
    rim = centres[:, None] + radius * (
        np.cos(turn)[None, :, None] * along[:, None] + np.sin(turn)[None, :, None] * up[None, None]
    )
    rim_px = project(camera, prism, rim.reshape(-1, 3), side)
    visible = np.isfinite(centre_px).all(axis=1)
    visible &= _clear(camera, prism, rim_px, side).reshape(len(centres), _RIM).all(axis=1)
    rays = trace_pixels(camera, prism, np.nan_to_num(rim_px))
    cosine = -np.einsum("ni,ni->n", rays.direction, np.repeat(normals, _RIM, axis=0))
    cosine = np.nan_to_num(cosine, nan=-1.0).reshape(len(centres), _RIM)
    visible &= (cosine >= math.cos(math.radians(STEEPEST_DEG))).all(axis=1)
    return DotView(side, np.arange(len(centres)), centres, centre_px, visible)


def _clear(camera: CameraOptics, prism: Biprism | None, pixels_px: FloatArray, side: int) -> NDArray[np.bool_]:
    """Which pixels lie in the view with `CLEARANCE_PX` to its borders; NaN does not."""
    pixels = np.nan_to_num(pixels_px, nan=-1e6)
    low = CLEARANCE_PX - 0.5
    clear = (pixels >= low).all(axis=1)
    clear &= (pixels[:, 0] <= camera.width_px - 1 - low) & (pixels[:, 1] <= camera.height_px - 1 - low)
    for step in ((CLEARANCE_PX, 0.0), (-CLEARANCE_PX, 0.0), (0.0, CLEARANCE_PX), (0.0, -CLEARANCE_PX)):
        neighbours = np.where(clear[:, None], pixels, 0.0) + step
        clear &= trace_pixels(camera, prism, neighbours).side == side
    return clear
