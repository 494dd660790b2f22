"""A rig whose images are exact projections by the twin's ray trace plus Gaussian noise: the truth for these tests."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from bscd.calibration import GridTarget, View
from drivers.twin.optics import LOOKING_ALONG_Y, Biprism, CameraOptics, look_at, rotation_xyz_deg
from drivers.twin.trace import project, trace_pixels

POSITIONS = tuple(range(-8, 9))


def paper_camera(position=(0.0, -622.0, 0.0), rotation=LOOKING_ALONG_Y, focal_length_mm=75.0, k1=-0.5):
    return CameraOptics(
        focal_length_mm, 0.0067, 1280, 1024, (639.5, 511.5), (k1, 0.0, 0.0, 0.0), tuple(position), rotation
    )


def _auxiliary(focal_length_mm=75.0, distance_mm=622.0, k1=-0.5):
    angle = np.deg2rad(20.0)
    position = distance_mm * np.array([np.sin(angle), -np.cos(angle), 0.0])
    return paper_camera(position, look_at(position, np.zeros(3)), focal_length_mm, k1)


def paper_prism(tilt_deg=(0.3, -0.4, 0.2), edge_mm=(0.0, -210.0, 0.0)):
    return Biprism(1.4585, 161.4, 30.0, 60.0, 50.0, edge_mm, rotation_xyz_deg(*tilt_deg))


@dataclass
class ExactRig:
    """Cameras, prism and stages; ``noise_px`` is the dots' noise per axis."""

    noise_px: float
    seed: int = 0
    primary: CameraOptics = field(default_factory=paper_camera)
    auxiliary: CameraOptics = field(default_factory=_auxiliary)
    prism: Biprism = field(default_factory=paper_prism)
    axis_point_mm: tuple[float, float, float] = (0.6, 13.5, 0.0)
    target: GridTarget = field(default_factory=GridTarget)

    def __post_init__(self):
        self.rng = np.random.default_rng(self.seed)
        self.axis = Rotation.from_euler("xy", [0.15, -0.1], degrees=True).apply([0.0, 0.0, 1.0])
        self.direction = Rotation.from_euler("xz", [0.2, -0.15], degrees=True).apply([0.0, 1.0, 0.0])

    def dots_mm(self, index, rotation_deg, y_mm, shift_mm=(0.0, 0.0, 0.0)):
        turn = Rotation.from_rotvec(self.axis * np.deg2rad(rotation_deg - 45.0))
        about = np.asarray(self.axis_point_mm)
        return turn.apply(self.target.points_mm(index) - about) + about + y_mm * self.direction + shift_mm

    def image(self, camera, index, points_mm):
        """(labels, pixels) of the dots that lie on the sensor."""
        optics, prism, side = {
            "primary": (self.primary, None, 0),
            "auxiliary": (self.auxiliary, None, 0),
            "left": (self.primary, self.prism, -1),
            "right": (self.primary, self.prism, 1),
        }[camera]
        pixels = project(optics, prism, points_mm, side)
        seen = np.isfinite(pixels[:, 0])
        seen[seen] = ((pixels[seen] > 10) & (pixels[seen] < [1269, 1013])).all(axis=1)
        pixels = pixels[seen] + self.rng.normal(0.0, self.noise_px, (seen.sum(), 2))
        return index[seen], pixels

    def view(self, camera, pose, position, y_mm=None, rotation_deg=None, shift_mm=(0.0, 0.0, 0.0)):
        rotation = {"corner": 45.0, "face": 0.0}[pose] if rotation_deg is None else rotation_deg
        y = 2.0 * position if y_mm is None else y_mm
        count = self.target.dots_per_face
        index = np.arange(2 * count if pose == "corner" else count)
        labels, pixels = self.image(camera, index, self.dots_mm(index, rotation, y, shift_mm))
        sigma = np.full(len(labels), max(self.noise_px, 1e-4))
        return View(camera, pose, position, y, rotation, labels, pixels, sigma)

    def scan(self, cameras, positions=POSITIONS, poses=("face",)):
        steps = [("corner", 0), *(("face", k) for k in positions)]
        if "corner" in poses:
            steps += [("corner", k) for k in positions if k]
        return [self.view(camera, pose, k) for pose, k in steps for camera in cameras]

    def reference(self, **kwargs):
        return self.scan(("primary", "auxiliary"), **kwargs)

    def bsc(self, **kwargs):
        return self.scan(("left", "right"), **kwargs)

    def second_acquisition(self, shift_mm=(0.7, 0.0, -0.4), rotation_deg=3.0, y_mm=(-15, -11, -7, -3, 1, 5, 9, 13, 15)):
        return [
            self.view(camera, "face", place, y, rotation_deg, shift_mm)
            for place, y in enumerate(y_mm)
            for camera in ("left", "right")
        ]

    def floor_mm(self, left_px, right_px):
        """The floor (DESIGN section 3): the points nearest to both exact rays of each pair of images."""
        normal, right_side = 0.0, 0.0
        for pixels in (left_px, right_px):
            rays = trace_pixels(self.primary, self.prism, pixels)
            across = np.eye(3) - rays.direction[:, :, None] * rays.direction[:, None, :]
            normal = normal + across
            right_side = right_side + np.einsum("nij,nj->ni", across, rays.origin_mm)
        return np.linalg.solve(normal, right_side[..., None])[..., 0]
