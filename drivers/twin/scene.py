"""Render the object on the stage, sharp and noise-free; and tell which material point a ray meets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.twin.bands import run_in_bands
from drivers.twin.cube import cube_arguments, render_cube_rows
from drivers.twin.light import pack_light
from drivers.twin.membrane import Membrane
from drivers.twin.optics import Biprism, CameraOptics, FloatArray
from drivers.twin.options import TwinOptions
from drivers.twin.placement import RigState, object_pose
from drivers.twin.sensor import FloatImage
from drivers.twin.speckle import speckle_coefficients
from drivers.twin.speckled import HIT_ROWS, hit_line, pack_body, render_body_rows
from drivers.twin.sphere import sphere_points
from drivers.twin.trace import Rays, pack_prism


@dataclass(frozen=True)
class SurfacePoints:
    """Where rays meet the speckled body; NaN where they miss it.

    ``material_mm`` ``(N, 2)``: the material point, which keeps its speckle: x' and y' on the flat membrane; on the
    sphere its place in the equal-area chart about the front pole, along x and z. ``xyz_mm`` ``(N, 3)``: where it is in
    the world. ``speckled`` ``(N,)``: whether it is speckled surface (not the membrane's clamping ring).
    """

    material_mm: FloatArray
    xyz_mm: FloatArray
    speckled: NDArray[np.bool_]


def render_scene(options: TwinOptions, camera: CameraOptics, prism: Biprism | None, state: RigState) -> FloatImage:
    """Brightness ``(H, W)`` averaged over each pixel's area, before the lens's blur and vignetting."""
    out = np.full((camera.height_px, camera.width_px), options.light.background, np.float32)
    cam, glass = camera.packed(), pack_prism(prism)
    if state.scene == "cube":
        pose, cube, light = cube_arguments(options, object_pose(options, state))
        run_in_bands(len(out), lambda a, b: render_cube_rows(a, b, cam, glass, pose, cube, light, out), small=64)
    elif state.scene in ("sphere", "membrane"):
        speckle = options.sphere.speckle if state.scene == "sphere" else options.membrane.speckle
        body = pack_body(options, state.pressure_kpa, state.scene)
        pose, light = object_pose(options, state).packed(), pack_light(options.light)
        paint = speckle_coefficients(speckle)
        nodes, weights = np.polynomial.legendre.leggauss(speckle.samples)
        nodes, weights = nodes / 2.0, weights / 2.0
        run_in_bands(
            len(out),
            lambda a, b: render_body_rows(a, b, nodes, weights, cam, glass, pose, body, paint, light, out),
            small=64,
        )
    return out


def meet_surface(options: TwinOptions, rays: Rays, state: RigState) -> SurfacePoints:
    """Where rays first meet the speckled body of the scene. Raises `ValueError` when there is none."""
    if state.scene not in ("sphere", "membrane"):
        raise ValueError(f"the scene {state.scene!r} has no speckled surface; place a sphere or the membrane")
    body, light = pack_body(options, state.pressure_kpa, state.scene), pack_light(options.light)
    pose = object_pose(options, state).packed()
    lines = np.ascontiguousarray(np.concatenate([rays.origin_mm, rays.direction], axis=1).T)
    hit = np.empty((HIT_ROWS, len(rays.side)))
    hit_line(lines, pose, body, light, hit)
    missed = (hit[0] == 0.0) | np.isnan(lines[0])
    found = np.where(missed, np.nan, hit[:7])
    return SurfacePoints(found[1:3].T.copy(), found[4:7].T.copy(), found[0] == 1.0)


def surface_positions(options: TwinOptions, material_mm: FloatArray, state: RigState) -> FloatArray:
    """World positions ``(N, 3)`` mm of material points ``(N, 2)`` mm of the scene's speckled body."""
    material = np.asarray(material_mm, float).reshape(-1, 2)
    pose = object_pose(options, state)
    if state.scene == "sphere":
        return pose.apply(sphere_points(material, options.sphere.radius_mm))
    if state.scene == "membrane":
        polar = np.stack(
            [np.hypot(material[:, 0], material[:, 1]), np.arctan2(material[:, 1], material[:, 0])], axis=-1
        )
        return pose.apply(Membrane(options.membrane).positions(polar, state.pressure_kpa))
    raise ValueError(f"the scene {state.scene!r} has no speckled surface; place a sphere or the membrane")
