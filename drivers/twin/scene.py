"""Render the object on the stage, sharp and noise-free."""

from __future__ import annotations

import numpy as np

from drivers.twin.bands import run_in_bands
from drivers.twin.cube import cube_arguments, render_cube_rows
from drivers.twin.optics import Biprism, CameraOptics
from drivers.twin.options import TwinOptions
from drivers.twin.placement import RigState, object_pose
from drivers.twin.sensor import FloatImage
from drivers.twin.trace import pack_prism


def render_scene(options: TwinOptions, camera: CameraOptics, prism: Biprism | None, state: RigState) -> FloatImage:
    """Brightness ``(H, W)`` averaged over each pixel's area, before the lens's blur and vignetting."""
    out = np.full((camera.height_px, camera.width_px), options.light.background, np.float32)
    cam, glass = camera.packed(), pack_prism(prism)
    if state.scene == "cube":
        pose, cube, light = cube_arguments(options, object_pose(options, state))
        run_in_bands(len(out), lambda a, b: render_cube_rows(a, b, cam, glass, pose, cube, light, out), small=64)
    return out
