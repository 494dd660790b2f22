"""Preliminary design of a biprism rig by the exact trace: what a prism, a lens and two distances give (section 2.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drivers.twin.optics import LOOKING_ALONG_Y, Biprism, CameraOptics, FloatArray
from drivers.twin.trace import LEFT, RIGHT, project, trace_pixels

_RAYS_PER_HALF = 5


@dataclass(frozen=True)
class RigDesign:
    """What an aligned rig sees of a target plane through the prism.

    Attributes
    ----------
    stereo_angle_deg : float
        Angle between the two rays that meet in the middle of the target.
    half_view_width_mm, view_height_mm : float
        Width that either half of the sensor sees at the target, and the smallest height.
    overlap_width_mm : float
        Width at the target that both halves see: where 3D can be measured. 0 where they see nothing in common.
    depth_per_px_mm : float
        Change of depth in the middle of the target per pixel of disparity.
    magnification_px_per_mm : float
        Image of a millimetre across the middle of the target.
    prism_width_mm, prism_height_mm : float
        The smallest prism that the sensor's whole view passes.
    prism_travel_mm : float
        How far a prism of that height must be lowered to leave the view.
    rays_xy_mm : tuple of ndarray (4, 2)
        Polylines camera, back face, roof, target in the x-y plane (z = 0), from the left of the sensor to the right.
    prism_outline_xy_mm : ndarray (6, 2)
        The prism of the needed width in the same plane, closed.
    """

    stereo_angle_deg: float
    half_view_width_mm: float
    view_height_mm: float
    overlap_width_mm: float
    depth_per_px_mm: float
    magnification_px_per_mm: float
    prism_width_mm: float
    prism_height_mm: float
    prism_travel_mm: float
    rays_xy_mm: tuple[FloatArray, ...]
    prism_outline_xy_mm: FloatArray


def design_rig(
    *,
    refractive_index: float,
    alpha_deg: float,
    thickness_mm: float,
    focal_length_mm: float,
    pixel_size_mm: float,
    width_px: int,
    height_px: int,
    object_distance_mm: float,
    camera_distance_mm: float,
) -> RigDesign:
    """Trace an aligned, distortion-free rig.

    ``object_distance_mm`` (the paper's d_o) runs from the roof edge to the target, ``camera_distance_mm`` (d_c) from
    the lens's centre of projection to the back face. The target's middle is the world's origin. Raises `ValueError`
    where no such rig can be built.
    """
    lengths = {
        "thickness_mm": thickness_mm,
        "focal_length_mm": focal_length_mm,
        "pixel_size_mm": pixel_size_mm,
        "object_distance_mm": object_distance_mm,
        "camera_distance_mm": camera_distance_mm,
    }
    for name, value in lengths.items():
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} = {value:g} must be a length above 0")
    if not (90.0 < alpha_deg < 180.0 and refractive_index > 1.0):
        raise ValueError(f"alpha_deg = {alpha_deg:g} must lie in 90..180 and refractive_index exceed 1")
    camera = CameraOptics(
        focal_length_mm=focal_length_mm,
        pixel_size_mm=pixel_size_mm,
        width_px=width_px,
        height_px=height_px,
        principal_px=((width_px - 1) / 2.0, (height_px - 1) / 2.0),
        distortion=(0.0, 0.0, 0.0, 0.0),
        position_mm=(0.0, -object_distance_mm - thickness_mm - camera_distance_mm, 0.0),
        rotation=LOOKING_ALONG_Y,
    )
    endless = 1e9
    prism = Biprism(
        refractive_index=refractive_index,
        alpha_deg=alpha_deg,
        thickness_mm=thickness_mm,
        width_mm=endless,
        height_mm=endless,
        edge_mm=(0.0, -object_distance_mm, 0.0),
        rotation=np.eye(3),
    )
    exits, at_target, heights = _border(camera, prism)
    half_width = float(np.abs(exits[:, 0]).max())
    if half_width * math.tan(prism.base_angle_rad) >= thickness_mm:
        raise ValueError(
            f"thickness_mm = {thickness_mm:g} is too thin: the view is {2 * half_width:.1f} mm wide at the roof, which "
            "falls behind the back face there; use a thicker or flatter prism or bring it closer to the camera"
        )
    prism_height = 2.0 * float(np.abs(exits[:, 2]).max())
    direct_half_height = height_px * pixel_size_mm / 2.0 / focal_length_mm * (thickness_mm + camera_distance_mm)
    left, right = (np.sort(at_target[side]) for side in (LEFT, RIGHT))
    stereo_deg, depth_per_px, magnification = _at_middle(camera, prism)
    drop = half_width * math.tan(prism.base_angle_rad)
    edge_y, back_y = -object_distance_mm, -object_distance_mm - thickness_mm
    outline = [
        (0.0, edge_y),
        (half_width, edge_y - drop),
        (half_width, back_y),
        (-half_width, back_y),
        (-half_width, edge_y - drop),
        (0.0, edge_y),
    ]
    return RigDesign(
        stereo_angle_deg=stereo_deg,
        half_view_width_mm=float(right[1] - right[0]),
        view_height_mm=heights,
        overlap_width_mm=max(0.0, float(min(left[1], right[1]) - max(left[0], right[0]))),
        depth_per_px_mm=depth_per_px,
        magnification_px_per_mm=magnification,
        prism_width_mm=2.0 * half_width,
        prism_height_mm=prism_height,
        prism_travel_mm=prism_height / 2.0 + direct_half_height,
        rays_xy_mm=_polylines(camera, prism),
        prism_outline_xy_mm=np.array(outline),
    )


def _border(camera: CameraOptics, prism: Biprism) -> tuple[FloatArray, dict[int, FloatArray], float]:
    """Where the view's border leaves the roof ``(N, 3)``; the x that each half sees at the target; its height."""
    split, top, bottom = camera.principal_px[0], -0.5, camera.height_px - 0.5
    near = 1e-6
    columns = {LEFT: (-0.5, split - near), RIGHT: (split + near, camera.width_px - 0.5)}
    corners = np.array([(c, r) for pair in columns.values() for c in pair for r in (top, bottom)])
    rays = trace_pixels(camera, prism, corners)
    if not np.isfinite(rays.origin_mm).all():
        raise ValueError("rays at the view's border are totally reflected in the prism; use a flatter prism")
    landing = rays.origin_mm - rays.direction * (rays.origin_mm[:, 1:2] / rays.direction[:, 1:2])
    height = float((landing[0::2, 2] - landing[1::2, 2]).min())
    at_target = {}
    for side, pair in columns.items():
        level = trace_pixels(camera, prism, np.array([(c, camera.principal_px[1]) for c in pair]))
        along = -level.origin_mm[:, 1] / level.direction[:, 1]
        at_target[side] = level.origin_mm[:, 0] + along * level.direction[:, 0]
    return rays.origin_mm, at_target, height


def _at_middle(camera: CameraOptics, prism: Biprism) -> tuple[float, float, float]:
    """Stereo angle (deg), depth per pixel of disparity (mm) and magnification (px/mm) in the middle of the target."""
    step = 0.5
    points = np.array([(0.0, 0.0, 0.0), (0.0, -step, 0.0), (0.0, step, 0.0), (-step, 0.0, 0.0), (step, 0.0, 0.0)])
    left, right = (project(camera, prism, points, side) for side in (LEFT, RIGHT))
    if not (np.isfinite(left).all() and np.isfinite(right).all()):
        raise ValueError("the two halves do not both see the target's middle; change the distances or the prism")
    directions = trace_pixels(camera, prism, np.stack([left[0], right[0]])).direction
    angle = math.degrees(math.acos(float(np.clip(directions[0] @ directions[1], -1.0, 1.0))))
    disparity = right[:, 0] - left[:, 0]
    depth_per_px = 2.0 * step / abs(float(disparity[2] - disparity[1]))
    return angle, depth_per_px, abs(float(right[4, 0] - right[3, 0])) / (2.0 * step)


def _polylines(camera: CameraOptics, prism: Biprism) -> tuple[FloatArray, ...]:
    """Rays of the sensor's middle row as polylines ``(4, 2)``: camera, back face, roof, target."""
    half = np.linspace(0.02, 1.0, _RAYS_PER_HALF) * camera.width_px / 2.0
    columns = camera.principal_px[0] + np.concatenate([-half[::-1], half])
    pixels = np.stack([columns, np.full(len(columns), camera.principal_px[1])], axis=-1)
    start, bent = trace_pixels(camera, None, pixels), trace_pixels(camera, prism, pixels)
    back_y = prism.edge_mm[1] - prism.thickness_mm
    lines = []
    for i in range(len(columns)):
        o, d, e, f = start.origin_mm[i], start.direction[i], bent.origin_mm[i], bent.direction[i]
        entry, target = o + d * (back_y - o[1]) / d[1], e - f * e[1] / f[1]
        lines.append(np.stack([o, entry, e, target])[:, :2].copy())
    return tuple(lines)
