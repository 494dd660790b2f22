"""Where the objects are: rigid poses, the stages' true axes, and remounting by hand."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from drivers.twin.optics import FloatArray
from drivers.twin.options import SceneName, StageOptions, TwinOptions


@dataclass(frozen=True)
class Pose:
    """A rigid map from a body's frame to the world: ``world = rotation @ body + origin_mm``."""

    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    origin_mm: FloatArray = field(default_factory=lambda: np.zeros(3))

    def apply(self, points_mm: FloatArray) -> FloatArray:
        """World positions ``(N, 3)`` mm of body points ``(N, 3)`` mm."""
        return np.asarray(points_mm, float) @ self.rotation.T + self.origin_mm

    def after(self, first: Pose) -> Pose:
        """The pose that applies ``first`` and then this one."""
        return Pose(self.rotation @ first.rotation, self.rotation @ first.origin_mm + self.origin_mm)

    def inverse(self) -> Pose:
        """The map from the world to the body."""
        return Pose(self.rotation.T, -self.rotation.T @ self.origin_mm)

    def packed(self) -> tuple[float, ...]:
        """Rotation by rows, then origin: 12 numbers for the kernels."""
        return (*self.rotation.ravel().tolist(), *self.origin_mm.tolist())


class Placement(NamedTuple):
    """How an object was put on the stage by hand.

    ``shift_mm`` and ``turn_deg`` (about world x, then y, then z, through the object's middle) move it from its
    nominal mount. A sphere or membrane is put where its options say whatever the stages read then
    (``rotation_deg``, ``translation_mm``) and rides on them from there; the cube is mounted in the corner pose at
    POS.0.
    """

    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation_deg: float = 0.0
    translation_mm: float = 0.0


class RigState(NamedTuple):
    """Everything that an image depends on beside the options; hashable, quantised by `World.state`."""

    rotation_deg: float
    translation_mm: float
    jack_mm: float
    pressure_kpa: float
    scene: SceneName
    placement: Placement


def stage_motion(stages: StageOptions, rotation_deg: float, translation_mm: float) -> Pose:
    """How the stages have moved what is on them since the corner pose at POS.0.

    A turn about the true rotation axis, then a shift along the true direction of travel.
    """
    tilt = np.tan(np.radians(stages.rotation_tilt_deg))
    axis = np.array([tilt[0], tilt[1], 1.0])
    axis /= np.linalg.norm(axis)
    travel = np.tan(np.radians(stages.translation_tilt_deg))
    direction = np.array([travel[0], 1.0, travel[1]])
    direction /= np.linalg.norm(direction)
    turn = Rotation.from_rotvec(axis * math.radians(rotation_deg - stages.corner_deg)).as_matrix()
    pivot = np.array([*stages.rotation_axis_mm, 0.0])
    return Pose(turn, pivot - turn @ pivot + direction * (translation_mm - stages.origin_mm))


def cube_size_mm(options: TwinOptions) -> tuple[float, float]:
    """Width of a face and height of the cube, mm: the grid with its margin all round."""
    cube = options.cube
    return (
        2.0 * cube.margin_mm + (cube.columns - 1) * cube.pitch_mm,
        2.0 * cube.margin_mm + (cube.rows - 1) * cube.pitch_mm,
    )


def nominal_pose(options: TwinOptions, scene: SceneName) -> tuple[Pose, FloatArray]:
    """The body's pose as mounted without shift and turn, and the body point ``(3,)`` that a turn leaves in place.

    The cube's own axes run along its right face, its left face and up, with the origin on the edge. The sphere's
    are the world's. The membrane's are x', y', z' of DESIGN section 2: z' towards the camera.
    """
    if scene == "cube":
        c = 1.0 / math.sqrt(2.0)
        side, _ = cube_size_mm(options)
        return Pose(np.array([[c, -c, 0.0], [c, c, 0.0], [0.0, 0.0, 1.0]])), np.array([side / 2.0, side / 2.0, 0.0])
    if scene == "sphere":
        return Pose(np.eye(3), np.asarray(options.sphere.centre_mm, float)), np.zeros(3)
    facing = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    tilt = Rotation.from_euler("xyz", options.membrane.tilt_deg, degrees=True).as_matrix()
    return Pose(tilt @ facing, np.asarray(options.membrane.centre_mm, float)), np.zeros(3)


def object_pose(options: TwinOptions, state: RigState) -> Pose:
    """The pose of the object on the stage in a state of the rig."""
    mount, middle = nominal_pose(options, state.scene)
    pivot = mount.apply(middle)
    turn = Rotation.from_euler("xyz", state.placement.turn_deg, degrees=True).as_matrix()
    remount = Pose(turn, pivot - turn @ pivot + np.asarray(state.placement.shift_mm))
    moved = stage_motion(options.stages, state.rotation_deg, state.translation_mm)
    if state.scene != "cube":
        placed = stage_motion(options.stages, state.placement.rotation_deg, state.placement.translation_mm)
        moved = moved.after(placed.inverse())
    return moved.after(remount).after(mount)
